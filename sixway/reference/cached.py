"""All six lights at once: what reaches each voxel is computed once and kept on grids, then one camera march.

1. optical depth from every voxel to each light (interpolated as optical depth, not as transmittance,
   which is convex and would come out too bright);
2. scattered light at every voxel of a grid that may be coarser, because this light is smooth: one bounce
   after the other, each gathered from the one before;
3. a deterministic march through every pixel: single scattering exactly, further bounces from the grid, and
   transmittance.

Only step 2 is random. Voxels no smoke can ask for are left out. Lights that stand equally in the world are the
same for every camera: their optical depths, and where smoke scatters evenly (hg_g 0) their scattered light.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, Bounces
from sixway.core.frames import Camera, Vector, enough_divisions
from sixway.core.records import DensityFrame, Medium
from sixway.reference import kernels
from sixway.reference.lights import sun_disc
from sixway.reference.media import Extinction, coarsened, cropped, refined
from sixway.reference.sweep import Sweep
from sixway.reference.view import SIX_LIGHTS, View, grid_on_device, vector
from sixway.reference.voxels import DirectionalField, Field, Voxels

_CAMERA_CUTOFF = 1e-4
_TAIL_TOLERANCE = 0.002  # of the scattered light: below it the remaining bounces are a geometric series
_MOST_BOUNCES = 200
_LEAST_TRANSMITTANCE = 1e-30
MOST_ANISOTROPIC = 0.3
_THICK = 0.4  # optical depth of a voxel above which light between voxels is too far from what linear values say
_MOST_VOXELS = 1 << 24  # half a gigabyte of fields


class CachedTracer:
    """Reusable over frames, cameras and seeds without compiling again. Needs a JIT variant of Mitsuba."""

    def __init__(
        self,
        *,
        bounces: Bounces,
        samples: int,
        medium: Medium,
        source_optical_depth: float = 0.3,
        light_angle_deg: float = 0.0,
    ) -> None:
        """samples: directions per voxel and bounce. Raises ValueError for what the grids cannot hold.

        source_optical_depth: of the thickest voxel of the grid that scattered light is kept on. As long as it
        stays below, voxels of that grid are 2 or 4 times larger than those of the smoke.
        """
        if bounces == "multi" and abs(medium.hg_g) > MOST_ANISOTROPIC:
            raise ValueError(
                f"hg_g={medium.hg_g} with bounces 'multi' needs scattered light by direction, of which method "
                f"'cached' keeps too little beyond {MOST_ANISOTROPIC}; use method 'path', or bounces 'paper' or "
                "'single'"
            )
        self.bounces = bounces
        self.medium = medium
        self._light_angle_deg = light_angle_deg
        self._even = medium.hg_g == 0.0
        self._coarsest = source_optical_depth
        self._samples = dr.opaque(mi.UInt32, samples)
        self._albedo = dr.opaque(mi.Float, medium.grey_albedo)
        self._g = dr.opaque(mi.Float, medium.hg_g)

    def trace(
        self,
        frame: DensityFrame,
        camera: Camera,
        *,
        seed: int,
        to_lights: Sequence[Vector] = SIX_LIGHTS,
        smoke: "LitSmoke | None" = None,
    ) -> Float[np.ndarray, "h w 7"]:
        """The only view of `trace_views`."""
        (image,) = self.trace_views(frame, [camera], seeds=[seed], to_lights=to_lights, smoke=smoke)
        return image

    def trace_views(
        self,
        frame: DensityFrame,
        cameras: Sequence[Camera],
        *,
        seeds: Sequence[int],
        to_lights: Sequence[Vector] = SIX_LIGHTS,
        smoke: "LitSmoke | None" = None,
    ) -> Iterator[Float[np.ndarray, "h w 7"]]:
        """M = pi L / E of six lights (`View` says which) and alpha from every camera, float32.

        smoke: of `smoke_of` this frame, for those who keep it.
        """
        smoke = smoke or self.smoke_of(frame)
        if smoke is None:
            for camera in cameras:
                yield np.zeros((camera.height_px, camera.width_px, len(DIRECTIONS) + 1), np.float32)
            return
        extinction = smoke.extinction
        lights = [[_rounded(camera.to_world(to_light)) for to_light in to_lights] for camera in cameras]
        for number, (camera, seed) in enumerate(zip(cameras, seeds, strict=True)):
            view = View(extinction, camera, to_lights, divisions=enough_divisions(extinction.grid, camera))
            lit = smoke.lit(lights[number])
            yield self._look(view, lights[number], lit, self._scattered(smoke, view, lit, lights[number:], seed=seed))

    def smoke_of(self, frame: DensityFrame) -> "LitSmoke | None":
        """What all views of a frame share, whatever the albedo; None where there is no smoke."""
        extinction = cropped(frame, self.medium)
        if extinction is None:
            return None
        return LitSmoke(extinction, self._coarsest, self._light_angle_deg)

    def _scattered(
        self, smoke: "LitSmoke", view: View, lit: Field, lights: Sequence[Sequence[Vector]], *, seed: int
    ) -> Field | None:
        """Light that was scattered at least once before it is scattered towards the first view's camera.

        lights: of this view and of all that follow.
        """
        if self.bounces == "single":
            return None
        voxels = smoke.coarse
        if self._even:
            return self._kept(smoke, lights, seed=seed)[0]
        kept = None
        if self.bounces == "multi":
            kept = DirectionalField(self._kept(smoke, lights, seed=seed), view.to_lights)

        def sample(point, ray):
            fields = lit.at(point)
            return fields if kept is None else [*fields, *kept.at(point, ray)[1:7]], mi.Bool(False)

        received = kernels.gathered(
            sample,
            _sun_and_more,
            voxels.box,
            voxels.centres,
            view.to_camera(voxels.centres),
            self._discs(lights[0]),
            **self._gathering(voxels, seed=seed, order=0),
        )
        return voxels.field(voxels.sharpened(received))

    def _kept(self, smoke: "LitSmoke", lights: Sequence[Sequence[Vector]], *, seed: int) -> list[Field]:
        """Scattered light that no camera changes of the first six lights, by moments; only what is unknown is traced.

        Lights of later views fill up six, because six cost as much as one.
        """
        wanted = [light for six in lights for light in six]
        while unknown := [light for light in dict.fromkeys(lights[0]) if light not in smoke.scattered]:
            later = [light for light in dict.fromkeys(wanted) if light not in smoke.scattered]
            six = (list(dict.fromkeys([*unknown, *later])) + [unknown[0]] * 5)[:6]
            moments = self._moments(smoke, six, seed=seed)
            smoke.scattered.update(zip(six, zip(*moments, strict=True), strict=True))
        kept = [
            smoke.coarse.field(list(six)) for six in zip(*(smoke.scattered[light] for light in lights[0]), strict=True)
        ]
        for light in smoke.scattered.keys() - set(wanted[len(lights[0]) :]):
            del smoke.scattered[light]
        return kept

    def _moments(self, smoke: "LitSmoke", lights: Sequence[Vector], *, seed: int) -> list[kernels.Six]:
        """Bounce after bounce; with `multi` until the rest is a geometric series whose sum is small, which is added."""
        voxels = smoke.coarse
        newest = total = self._bounce(voxels, smoke.lit(lights), kernels.sunlight, lights, seed=seed, order=1)
        tail = 0.0
        energy = all_energy = _energy(newest)
        for order in range(2, _MOST_BOUNCES + 1 if self.bounces == "multi" else 2):
            fields = [voxels.field(voxels.sharpened(six)) for six in newest]
            light = fields[0] if self._even else DirectionalField(fields, [vector(to_light) for to_light in lights])
            newest = self._bounce(voxels, light, kernels.scattered_light, lights, seed=seed, order=order)
            total = _sum(total, mi.Float(1), newest)
            dr.eval(total)  # else the sum would grow into a kernel of its own for every number of bounces
            previous, energy = energy, _energy(newest)
            all_energy += energy
            ratio = min(energy / previous, 0.99) if previous > 0.0 else 0.0
            tail = ratio / (1.0 - ratio)
            if energy * tail <= _TAIL_TOLERANCE * all_energy:
                break
        return [voxels.sharpened(six) for six in _sum(total, dr.opaque(mi.Float, tail), newest)]

    def _bounce(
        self,
        voxels: Voxels,
        light: Field | DirectionalField,
        source: kernels.Source,
        lights: Sequence[Vector],
        *,
        seed: int,
        order: int,
    ) -> list[kernels.Six]:
        """What the voxels receive from the light that `light` holds, scattered once more on its way, by moments."""

        def sample(point, ray):
            return light.at(point, ray), mi.Bool(False)

        to_lights, discs = [vector(to_light) for to_light in lights], self._discs(lights)
        gathering = self._gathering(voxels, seed=seed, order=order)
        if self._even:
            anywhere = vector((0.0, 0.0, 1.0))  # evenly scattered light leaves alike in all directions
            received = [kernels.gathered(sample, source, voxels.box, voxels.centres, anywhere, discs, **gathering)]
        else:
            received = kernels.gathered_moments(
                sample, source, voxels.box, voxels.centres, to_lights, discs, **gathering
            )
        dr.eval(received)
        return received

    def _discs(self, lights: Sequence[Vector]) -> list[list]:
        return [[vector(sun) for sun in sun_disc(to_light, self._light_angle_deg)] for to_light in lights]

    def _gathering(self, voxels: Voxels, *, seed: int, order: int) -> dict[str, Any]:
        step_seed = dr.opaque(mi.UInt32, (seed + order * 0x9E3779B9) & 0xFFFFFFFF)
        return {
            "step": voxels.box.voxel,
            "rotation": kernels.uniform_triple(voxels.active, step_seed),
            "samples": self._samples,
            "g": self._g,
            "albedo": self._albedo,
        }

    def _look(
        self, view: View, lights: Sequence[Vector], lit: Field, scattered: Field | None
    ) -> Float[np.ndarray, "h w 7"]:
        origin, ray, offset = view.march_rays()

        def sample(point, ray):
            fields = lit.at(point)
            if scattered is not None:
                fields = [*fields, *scattered.at(point)[1:7]]
            return fields, fields[7] > 0.5

        radiance, transmittance = kernels.march(
            sample,
            _sun_and_more,
            view.box,
            origin,
            ray,
            kernels.phases(self._discs(lights), ray, self._g),
            offset=offset,
            step=view.box.voxel,
            albedo=self._albedo,
            cutoff=_CAMERA_CUTOFF,
        )
        return view.image([*(dr.pi * dr.maximum(value, 0.0) for value in radiance), 1.0 - transmittance])


class LitSmoke:
    """What the views of a frame share: its voxels, and what is known of the lights by their place in the world.

    fine: voxels of the smoke. coarse: those that scattered light is kept on. scattered: by light, per coarse voxel.
    """

    def __init__(self, extinction: Extinction, largest_optical_depth: float, light_angle_deg: float) -> None:
        self.extinction = _thin_enough(extinction)
        self._light_angle_deg = light_angle_deg
        self.fine = self.coarse = Voxels(self.extinction)
        factor = _coarsening(extinction, largest_optical_depth)
        if factor > 1 or self.extinction is not extinction:  # scattered light is smooth: it needs no divided voxels
            self.coarse = Voxels(coarsened(extinction, factor))
        self.scattered: dict[Vector, tuple] = {}
        self._sigma_t = grid_on_device(self.extinction.sigma_t)
        self._depths: dict[Vector, mi.Float] = {}

    def lit(self, lights: Sequence[Vector]) -> Field:
        """Optical depth from every fine voxel to six lights, beside sigma_t and the solid fraction."""
        for light in lights:
            if light not in self._depths:
                self._depths[light], self._depths[_opposite(light)] = self._both_depths(light)
        return self.fine.field([self._depths[light] for light in lights])

    def _both_depths(self, light: Vector) -> tuple:
        """Towards a light and its opposite. Of wide lights the mean transmittance counts, not the mean depth."""
        disc = sun_disc(light, self._light_angle_deg)
        passed = [mi.Float(0), mi.Float(0)]
        for to_light in disc:
            both = Sweep(self._sigma_t, self.fine.box, self.extinction.grid, to_light).at_voxels(self.fine.centres)
            dr.eval(both)
            if len(disc) == 1:
                return both
            passed = [total + dr.exp(-depth) for total, depth in zip(passed, both, strict=True)]
            dr.eval(passed)
        count = dr.opaque(mi.Float, len(disc))
        towards, away = (-dr.log(dr.maximum(total / count, _LEAST_TRANSMITTANCE)) for total in passed)
        return towards, away


def _rounded(to_light: Vector) -> Vector:
    """Equal for lights that differ by the rounding of a camera's angles only."""
    x, y, z = (round(value, 6) + 0.0 for value in to_light)
    return x, y, z


def _opposite(to_light: Vector) -> Vector:
    x, y, z = (0.0 - value for value in to_light)
    return x, y, z


def _thin_enough(extinction: Extinction) -> Extinction:
    """On finer voxels while the thickest is too thick, as far as memory goes."""
    while _thickest(extinction) > _THICK and 8 * extinction.sigma_t.size <= _MOST_VOXELS:
        extinction = refined(extinction)
    return extinction


def _coarsening(extinction: Extinction, largest_optical_depth: float) -> int:
    thickest = _thickest(extinction)
    return next(factor for factor in (4, 2, 1) if factor == 1 or factor * thickest <= largest_optical_depth)


def _thickest(extinction: Extinction) -> float:
    """Optical depth of a voxel."""
    return float(extinction.sigma_t.max()) * extinction.grid.voxel_size_m


def _sun_and_more(fields, phase: kernels.Six) -> kernels.Six:
    """Of lights by their optical depths and, where fields go on, of scattered light."""
    light = kernels.sunlight(fields, phase)
    return [a + b for a, b in zip(light, fields[8:14], strict=True)] if len(fields) > 8 else light


def _sum(moments: list[kernels.Six], weight, more: list[kernels.Six]) -> list[kernels.Six]:
    return [kernels.add_weighted(a, weight, b) for a, b in zip(moments, more, strict=True)]


def _energy(moments: list[kernels.Six]) -> float:
    """Of light from everywhere: the first moment."""
    return sum(float(dr.sum(value)[0]) for value in moments[0])
