"""Unbiased paths that all six lights share: the audit of the cached method, cheaper than six renders.

A path starts at the camera and flies from collision to collision by delta tracking. At every collision
it asks all six lights how much of them arrives, by ratio tracking, and goes on as the phase function
says. Alpha comes from a march without chance.
"""

import math
from collections.abc import Iterator, Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, Bounces
from sixway.core.frames import SUBPIXELS, Camera, Vector
from sixway.core.records import DensityFrame, Medium
from sixway.reference import kernels
from sixway.reference.media import cropped
from sixway.reference.tracking import delta_tracked, ratio_tracked
from sixway.reference.view import SIX_LIGHTS, View, grid_on_device

_MOST_SCATTERINGS: dict[Bounces, int] = {"single": 1, "paper": 2, "multi": 0xFFFFFFFF}
_ROULETTE_FROM = 16  # scatterings; from here on a path survives with probability albedo
_PATHS_PER_PASS = 1 << 25  # seconds, not minutes, between two chances to interrupt


class PathTracer:
    """Reusable over frames, cameras and seeds without compiling again. Needs a JIT variant of Mitsuba.

    samples: paths per pixel, for all lights together, rounded up to a multiple of 16: one for each
    sub-pixel. Noise falls with 1 / sqrt(samples).
    """

    def __init__(self, *, bounces: Bounces, samples: int, medium: Medium, light_angle_deg: float = 0.0) -> None:
        self.medium = medium
        self._rounds = -(-samples // SUBPIXELS**2)
        self._most_scatterings = dr.opaque(mi.UInt32, _MOST_SCATTERINGS[bounces])
        self._albedo = dr.opaque(mi.Float, medium.grey_albedo)
        half_angle = math.radians(0.5 * light_angle_deg)
        self._cosine = dr.opaque(mi.Float, math.cos(half_angle)) if light_angle_deg > 0.0 else None
        self._g = dr.opaque(mi.Float, medium.hg_g)

    def trace_views(
        self, frame: DensityFrame, cameras: Sequence[Camera], *, seeds: Sequence[int]
    ) -> Iterator[Float[np.ndarray, "h w 7"]]:
        """Each camera's picture on its own: paths share nothing."""
        for camera, seed in zip(cameras, seeds, strict=True):
            yield self.trace(frame, camera, seed=seed)

    def trace(
        self, frame: DensityFrame, camera: Camera, *, seed: int, to_lights: Sequence[Vector] = SIX_LIGHTS
    ) -> Float[np.ndarray, "h w 7"]:
        """M = pi L / E of six lights (`View` says which) and alpha, float32."""
        extinction = cropped(frame, self.medium)
        if extinction is None:
            return np.zeros((camera.height_px, camera.width_px, len(DIRECTIONS) + 1), np.float32)
        view = View(extinction, camera, to_lights)
        solid = grid_on_device(extinction.solid)
        # a little more than the maximum, which rounding in the interpolation can exceed
        majorant = dr.opaque(mi.Float, (1.0 + 1e-5) * float(extinction.sigma_t.max()))
        reach = dr.opaque(mi.Float, float("inf") if extinction.solid.any() else 0.0)
        per_pass = max(1, _PATHS_PER_PASS // (camera.width_px * camera.height_px * SUBPIXELS**2))
        passes = [min(per_pass, self._rounds - done) for done in range(0, self._rounds, per_pass)]
        total = np.zeros((camera.height_px, camera.width_px, len(DIRECTIONS)))
        pass_seeds = np.random.SeedSequence(seed).generate_state(len(passes))
        for rounds, pass_seed in zip(passes, pass_seeds, strict=True):
            total += rounds * self._pass(view, solid, majorant, reach, rounds=rounds, seed=int(pass_seed))
        alpha = march_alpha(view, solid)
        return np.concatenate([(total / self._rounds).astype(np.float32), alpha], axis=-1)

    def _pass(self, view: View, solid, majorant, reach, *, rounds: int, seed: int) -> Float[np.ndarray, "h w 6"]:
        x, y, _ = view.subpixels()
        random = mi.PCG32(  # type: ignore[operator]  # its stub says object
            size=dr.width(x), initstate=dr.opaque(mi.UInt64, seed), initseq=dr.arange(mi.UInt64, dr.width(x))
        )
        total = _paths(
            view,
            solid,
            (x, y),
            random,
            majorant=majorant,
            reach=reach,
            rounds=dr.opaque(mi.UInt32, rounds),
            most_scatterings=self._most_scatterings,
            albedo=self._albedo,
            g=self._g,
            disc=self._cosine,
        )
        scale = dr.opaque(mi.Float, np.pi / rounds)
        return view.image([value * scale for value in total])


@dr.syntax
def _paths(view, solid, corner, random, *, majorant, reach, rounds, most_scatterings, albedo, g, disc):
    """Sum over `rounds` paths from each sub-pixel of the radiance of six lights of irradiance 1.

    A finished path is followed by the next one at once, so that lanes of unequal paths stay busy.
    """
    box = view.box
    total = [mi.Float(0) for _ in range(6)]
    origin, ray, start, end = _camera_ray(view, solid, corner, random, reach)
    weight = mi.Float(1)
    scatterings = mi.UInt32(0)
    finished = mi.UInt32(0)
    while finished < rounds:
        distance, collided = delta_tracked(view.sigma_t, box, origin, ray, start, end, majorant, random, start < end)
        point = origin + distance * ray
        weight = dr.select(collided, weight * albedo, 0.0)
        arriving = _next_events(view, point, ray, majorant, random, collided, g, disc)
        total = kernels.add_weighted(total, weight, arriving)
        scatterings += 1

        late = scatterings >= _ROULETTE_FROM
        survives = collided & (scatterings < most_scatterings) & (~late | (random.next_float32() < albedo))
        weight = dr.select(late & (albedo > 0.0), weight / albedo, weight)
        u, v = random.next_float32(), random.next_float32()
        onward = mi.Frame3f(ray).to_world(kernels.sample_henyey_greenstein(u, v, g))
        _, face = box.span(point, onward)
        next_origin, next_ray, next_start, next_end = _camera_ray(view, solid, corner, random, reach)
        origin = dr.select(survives, point, next_origin)
        ray = dr.select(survives, onward, next_ray)
        start = dr.select(survives, 0.0, next_start)
        end = dr.select(survives, face, next_end)
        weight = dr.select(survives, weight, 1.0)
        scatterings = dr.select(survives, scatterings, 0)
        finished += dr.select(survives, mi.UInt32(0), mi.UInt32(1))
    return total


def _next_events(view, point, ray, majorant, random, active, g, disc) -> kernels.Six:
    """Radiance [1/sr per unit irradiance] that each light sends back along `ray` from a collision.

    disc: cosine of the angle from a light's centre to its edge, of which one point is asked; None for a point.
    """
    to_lights = view.to_lights if disc is None else [_on_disc(axis, disc, random) for axis in view.to_lights]
    return [
        phase * ratio_tracked(view.sigma_t, view.box, point, to_light, majorant, random, active)
        for phase, to_light in zip(
            kernels.phases([[to_light] for to_light in to_lights], ray, g), to_lights, strict=True
        )
    ]


def _on_disc(axis, disc, random):
    sample = mi.Point2f(random.next_float32(), random.next_float32())
    return mi.Frame3f(axis).to_world(mi.warp.square_to_uniform_cone(sample, disc))


def _camera_ray(view, solid, corner, random, reach):
    """A ray through a random point of each sub-pixel: origin, unit vector, and where smoke begins and ends."""
    x, y = (edge + random.next_float32() / SUBPIXELS for edge in corner)
    origin, ray = view.rays(x, y)
    start, end = view.box.span(origin, ray)
    return origin, ray, start, first_solid(solid, view.box, origin, ray, start, dr.minimum(end, reach), end)


@dr.syntax
def first_solid(solid, box, origin, ray, start, stop, end):
    """Distance [m] to the first solid between `start` and `stop`, in steps of a voxel; `end` if there is none."""
    distance = start + 0.5 * box.voxel
    wall = mi.Float(end)
    while distance < stop:
        blocked = solid.eval(box.to_texture(origin + distance * ray))[0] > 0.5
        wall = dr.select(blocked, distance, wall)
        stop = dr.select(blocked, distance, stop)
        distance += box.voxel
    return wall


def march_alpha(view: View, solid) -> Float[np.ndarray, "h w 1"]:
    """1 - transmittance of every pixel, by the march of the cached method."""
    origin, ray, offset = view.march_rays()

    def sample(point, ray):
        inside = view.box.to_texture(point)
        return view.sigma_t.eval(inside), solid.eval(inside)[0] > 0.5

    def nothing(*segment):
        return [mi.Float(0)] * 6

    _, transmittance = kernels.march(
        sample,
        nothing,
        view.box,
        origin,
        ray,
        [],
        offset=offset,
        step=view.box.voxel,
        albedo=mi.Float(0),
        cutoff=0.0,
    )
    return view.image([1.0 - transmittance])
