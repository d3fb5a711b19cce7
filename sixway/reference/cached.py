"""All six lights at once: what reaches each voxel is computed once and kept on grids, then one camera march.

1. optical depth from every voxel to each light (interpolated as optical depth, not as transmittance,
   which is convex and would come out too bright);
2. scattered light at every voxel of a grid that may be coarser, because this light is smooth: one bounce
   after the other, each gathered from the one before;
3. a deterministic march from 4 x 4 points of every pixel: single scattering exactly, further bounces
   from the grid, and transmittance.

Only step 2 is random. Voxels no smoke can ask for are left out.
"""

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, Bounces
from sixway.core.frames import Camera, Vector
from sixway.core.records import DensityFrame, Medium
from sixway.reference import kernels
from sixway.reference.emission import with_emissive
from sixway.reference.media import Extinction, coarsened, cropped
from sixway.reference.view import SIX_LIGHTS, View
from sixway.reference.voxels import Field, Voxels

_CAMERA_CUTOFF = 1e-4
_TAIL_TOLERANCE = 0.002  # of the scattered light: below it the remaining bounces are a geometric series
_MOST_BOUNCES = 200


class CachedTracer:
    """Reusable over frames, cameras and seeds without compiling again. Needs a JIT variant of Mitsuba."""

    def __init__(self, *, bounces: Bounces, samples: int, medium: Medium, source_optical_depth: float = 0.3) -> None:
        """samples: directions per voxel and bounce. Raises ValueError for what the grids cannot hold.

        source_optical_depth: of the thickest voxel of the grid that scattered light is kept on. As long as it
        stays below, voxels of that grid are 2 or 4 times larger than those of the smoke.
        """
        if bounces == "multi" and medium.hg_g != 0.0:
            raise ValueError(
                f"hg_g={medium.hg_g} with bounces 'multi' needs scattered light by direction, which method "
                "'cached' does not keep; use method 'path', or bounces 'paper' or 'single'"
            )
        self.bounces = bounces
        self.medium = medium
        self._coarsest = source_optical_depth
        self._samples = dr.opaque(mi.UInt32, samples)
        self._albedo = dr.opaque(mi.Float, medium.albedo)
        self._g = dr.opaque(mi.Float, medium.hg_g)

    def trace(
        self, frame: DensityFrame, camera: Camera, *, seed: int, to_lights: Sequence[Vector] = SIX_LIGHTS
    ) -> Float[np.ndarray, "h w c"]:
        """M = pi L / E of six lights (`View` says which), alpha, and emissive if the frame has emission; float32."""
        return with_emissive(self._lit(frame, camera, seed, to_lights), frame, camera, self.medium)

    def _lit(
        self, frame: DensityFrame, camera: Camera, seed: int, to_lights: Sequence[Vector]
    ) -> Float[np.ndarray, "h w 7"]:
        extinction = cropped(frame, self.medium)
        if extinction is None:
            return np.zeros((camera.height_px, camera.width_px, len(DIRECTIONS) + 1), np.float32)
        fine = Voxels(extinction, camera, to_lights)
        lit = self._light(fine)
        if self.bounces == "single":
            return self._look(fine.view, lit, None)
        voxels = fine
        factor = _coarsening(extinction, self._coarsest)
        if factor > 1:
            voxels = Voxels(coarsened(extinction, factor), camera, to_lights)
        scattered = self._bounce(voxels, lit, kernels.sunlight, seed=seed, order=1)
        if self.bounces == "multi":
            scattered = self._further_bounces(voxels, scattered, seed=seed)
        return self._look(fine.view, lit, voxels.field(voxels.sharpened(scattered)))

    def _light(self, voxels: Voxels) -> Field:
        """Optical depth from every voxel to the six lights, beside sigma_t and the solid fraction."""
        view = voxels.view
        return voxels.field(
            [kernels.optical_depth(view.sigma_t, view.box, voxels.centres, to_light) for to_light in view.to_lights]
        )

    def _bounce(self, voxels: Voxels, light: Field, source: kernels.Source, *, seed: int, order: int) -> kernels.Six:
        """What the voxels receive from the light that `light` holds, scattered once more on its way."""
        step_seed = dr.opaque(mi.UInt32, (seed + order * 0x9E3779B9) & 0xFFFFFFFF)
        received = kernels.gathered(
            lambda point: (light.at(point), mi.Bool(False)),
            source,
            light.box,
            voxels.centres,
            voxels.to_camera,
            voxels.view.to_lights,
            step=voxels.view.box.voxel,
            rotation=kernels.uniform_pair(voxels.active, step_seed),
            samples=self._samples,
            g=self._g,
            albedo=self._albedo,
        )
        dr.eval(received)
        return received

    def _further_bounces(self, voxels: Voxels, first: kernels.Six, *, seed: int) -> kernels.Six:
        """Bounce after bounce until the rest is a geometric series whose sum is small, which is then added."""
        newest = total = first
        tail = 0.0
        energy = all_energy = _energy(newest)
        for order in range(2, _MOST_BOUNCES + 1):
            newest = self._bounce(
                voxels, voxels.field(voxels.sharpened(newest)), kernels.scattered_light, seed=seed, order=order
            )
            total = [a + b for a, b in zip(total, newest, strict=True)]
            dr.eval(total)  # else the sum would grow into a kernel of its own for every number of bounces
            previous, energy = energy, _energy(newest)
            all_energy += energy
            ratio = min(energy / previous, 0.99) if previous > 0.0 else 0.0
            tail = ratio / (1.0 - ratio)
            if energy * tail <= _TAIL_TOLERANCE * all_energy:
                break
        rest = dr.opaque(mi.Float, tail)
        return [a + rest * b for a, b in zip(total, newest, strict=True)]

    def _look(self, view: View, lit: Field, scattered: Field | None) -> Float[np.ndarray, "h w 7"]:
        origin, ray, offset = view.march_rays()

        def sample(point):
            fields = lit.at(point)
            if scattered is not None:
                fields = [*fields, *scattered.at(point)[1:7]]
            return fields, fields[7] > 0.5

        def source(fields, phase):
            light = kernels.sunlight(fields, phase)
            return light if scattered is None else [a + b for a, b in zip(light, fields[8:14], strict=True)]

        radiance, transmittance = kernels.march(
            sample,
            source,
            view.box,
            origin,
            ray,
            kernels.phases(view.to_lights, ray, self._g),
            offset=offset,
            step=view.box.voxel,
            albedo=self._albedo,
            cutoff=_CAMERA_CUTOFF,
        )
        return view.image([*(dr.pi * value for value in radiance), 1.0 - transmittance])


def _coarsening(extinction: Extinction, largest_optical_depth: float) -> int:
    thickest = float(extinction.sigma_t.max()) * extinction.grid.voxel_size_m
    return next(factor for factor in (4, 2, 1) if factor == 1 or factor * thickest <= largest_optical_depth)


def _energy(six: kernels.Six) -> float:
    return sum(float(dr.sum(value)[0]) for value in six)
