"""All six lights at once: what reaches each voxel is computed once and kept on grids, then one camera march.

1. optical depth from every voxel to each light (interpolated as optical depth, not as transmittance,
   which is convex and would come out too bright);
2. scattered light at every voxel, one bounce after the other, each gathered from the one before;
3. a deterministic march from 4 x 4 points of every pixel: single scattering exactly, further bounces
   from the grid, and transmittance.

Only step 2 is random. Voxels no smoke can ask for are left out.
"""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, TO_LIGHT, Bounces
from sixway.core.frames import Camera, Vector
from sixway.core.records import DensityFrame, Medium
from sixway.reference import kernels
from sixway.reference.media import Extinction, cropped, reached

Texture = Any  # mi.Texture3f, a type only once a variant is set

_CHANNELS = 8  # sigma_t, six lights, solid: one packet load per corner of a voxel
_SUBPIXELS = 4
_CAMERA_CUTOFF = 1e-4
_TAIL_TOLERANCE = 0.002  # of the scattered light: below it the remaining bounces are a geometric series
_MOST_BOUNCES = 200


class CachedTracer:
    """Reusable over frames, cameras and seeds without compiling again. Needs a JIT variant of Mitsuba."""

    def __init__(self, *, bounces: Bounces, samples: int, medium: Medium) -> None:
        """samples: directions per voxel and bounce. Raises ValueError for what the grids cannot hold."""
        if bounces == "multi" and medium.hg_g != 0.0:
            raise ValueError(
                f"hg_g={medium.hg_g} with bounces 'multi' needs scattered light by direction, which method "
                "'cached' does not keep; use method 'stock', or bounces 'paper' or 'single'"
            )
        self.bounces = bounces
        self.medium = medium
        self._samples = dr.opaque(mi.UInt32, samples)
        self._albedo = dr.opaque(mi.Float, medium.albedo)
        self._g = dr.opaque(mi.Float, medium.hg_g)

    def trace(self, frame: DensityFrame, camera: Camera, *, seed: int) -> Float[np.ndarray, "h w 7"]:
        """M = pi L / E of the six lights and alpha, float32."""
        extinction = cropped(frame, self.medium)
        if extinction is None:
            return np.zeros((camera.height_px, camera.width_px, len(DIRECTIONS) + 1), np.float32)
        view = _View(extinction, camera)
        lit = self._light(view)
        match self.bounces:
            case "single":
                scattered = None
            case "paper":
                scattered = view.texture(self._bounce(view, lit, kernels.sunlight, seed=seed, order=1))
            case "multi":
                scattered = view.texture(self._all_bounces(view, lit, seed=seed))
        return self._look(view, lit, scattered)

    def _light(self, view: "_View") -> Texture:
        """Optical depth from every voxel to the six lights, beside sigma_t and the solid fraction."""
        return view.texture(
            [kernels.optical_depth(view.sigma_t, view.box, view.centres, to_light) for to_light in view.to_lights]
        )

    def _bounce(self, view: "_View", light: Texture, source: kernels.Source, *, seed: int, order: int) -> kernels.Six:
        """What the voxels receive from the light that `light` holds, scattered once more on its way."""
        step_seed = dr.opaque(mi.UInt32, (seed + order * 0x9E3779B9) & 0xFFFFFFFF)
        received = kernels.gathered(
            lambda point: (light.eval(point), mi.Bool(False)),
            source,
            view.box,
            view.centres,
            view.to_camera,
            view.to_lights,
            rotation=kernels.uniform_pair(view.active, step_seed),
            samples=self._samples,
            g=self._g,
            albedo=self._albedo,
        )
        dr.eval(received)
        return received

    def _all_bounces(self, view: "_View", lit: Texture, *, seed: int) -> kernels.Six:
        """Bounce after bounce until the rest is a geometric series whose sum is small, which is then added."""
        newest = self._bounce(view, lit, kernels.sunlight, seed=seed, order=1)
        total, tail = newest, 0.0
        energy = all_energy = _energy(newest)
        for order in range(2, _MOST_BOUNCES + 1):
            light = view.texture(newest)
            newest = self._bounce(view, light, kernels.scattered_light, seed=seed, order=order)
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

    def _look(self, view: "_View", lit: Texture, scattered: Texture | None) -> Float[np.ndarray, "h w 7"]:
        origin, ray, offset = view.camera_rays()

        def sample(point):
            fields = lit.eval(point)
            if scattered is not None:
                fields = [*fields, *scattered.eval(point)[1:7]]
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
        channels = [*(dr.pi * value for value in radiance), 1.0 - transmittance]
        dr.eval(channels)  # in one kernel: each block_sum would march again
        pixels = [dr.block_sum(value, _SUBPIXELS**2) / _SUBPIXELS**2 for value in channels]
        dr.eval(pixels)
        size = (view.camera.height_px, view.camera.width_px)
        return np.stack([np.array(value, dtype=np.float32).reshape(size) for value in pixels], axis=-1)


class _View:
    """One volume seen by one camera, on the device: where everything is, and textures over the grid."""

    def __init__(self, extinction: Extinction, camera: Camera) -> None:
        grid = extinction.grid
        self.camera = camera
        self.box = kernels.Box(
            origin=_point(grid.origin_m), extent=_vector(grid.extent_m), voxel=dr.opaque(mi.Float, grid.voxel_size_m)
        )
        self.to_lights = [_vector(camera.to_world(TO_LIGHT[name])) for name in DIRECTIONS]
        self._shape = grid.shape_zyx
        self._sigma_t = mi.Float(_aligned(extinction.sigma_t))
        self._solid = mi.Float(_aligned(extinction.solid))
        self.sigma_t = kernels.grid_texture(mi.TensorXf(self._sigma_t, (*grid.shape_zyx, 1)))
        active = np.flatnonzero(reached(extinction.sigma_t))
        self.active = mi.UInt32(_aligned(active.astype(np.uint32)))
        z, y, x = np.unravel_index(active, grid.shape_zyx)
        self.centres = mi.Point3f(
            *(
                mi.Float(_aligned(((index + 0.5) * grid.voxel_size_m + origin).astype(np.float32)))
                for index, origin in zip((x, y, z), grid.origin_m, strict=True)
            )
        )
        self._eye = _point(camera.position_m)
        self._backward = _vector(camera.to_viewer)
        self._is_pinhole = dr.opaque(mi.Float, float(camera.kind == "perspective"))

    @property
    def to_camera(self):
        """Unit vectors from the voxels towards the camera."""
        to_eye = dr.normalize(self._eye - self.centres)
        return dr.select(self._is_pinhole > 0.5, to_eye, self._backward)

    def texture(self, six: kernels.Six) -> Texture:
        """A texture of sigma_t, six values per active voxel, and the solid fraction."""
        dr.eval(six)  # in one kernel: each scatter below would run its own
        values = dr.zeros(mi.Float, int(np.prod(self._shape)) * _CHANNELS)
        every = dr.arange(mi.UInt32, int(np.prod(self._shape))) * _CHANNELS
        dr.scatter(values, self._sigma_t, every)
        dr.scatter(values, self._solid, every + 7)
        for channel, value in enumerate(six, start=1):
            dr.scatter(values, value, self.active * _CHANNELS + channel)
        return kernels.grid_texture(mi.TensorXf(values, (*self._shape, _CHANNELS)))

    def camera_rays(self):
        """Origins, unit vectors and march offsets of the sub-pixels; those of a pixel stand together.

        As `Camera.rays`, at the centres of a regular 4 x 4 division of every pixel. The offsets of a pixel's
        rays divide the step into sixteen, in an order that does not follow the rows.
        """
        camera, n = self.camera, _SUBPIXELS
        index = dr.arange(mi.UInt32, camera.width_px * camera.height_px * n * n)
        sub, pixel = index % (n * n), index // (n * n)
        width = dr.opaque(mi.UInt32, camera.width_px)
        column, row = mi.Float(pixel % width), mi.Float(pixel // width)
        u = (column + (mi.Float(sub % n) + 0.5) / n) * dr.opaque(mi.Float, 2.0 / camera.width_px) - 1.0
        v = 1.0 - (row + (mi.Float(sub // n) + 0.5) / n) * dr.opaque(mi.Float, 2.0 / camera.height_px)
        right, up, _ = camera.basis
        on_plane = _vector(right * camera.half_width_m) * u + _vector(up * camera.half_height_m) * v
        origin = self._eye + (1.0 - self._is_pinhole) * on_plane
        forward = self._is_pinhole * on_plane - _vector(camera.basis[2] * camera.distance_m)
        offset = (mi.Float((sub * 7) % (n * n)) + 0.5) / (n * n)
        return origin, dr.normalize(forward), offset


def _aligned(array: np.ndarray) -> np.ndarray:
    """A flat copy that starts at a multiple of 64 bytes.

    Dr.Jit uses NumPy's memory as it is, and compiles one kernel for aligned and another for other loads.
    """
    raw = np.empty(array.nbytes + 64, np.uint8)
    start = -raw.ctypes.data % 64
    copy = raw[start : start + array.nbytes].view(array.dtype)
    copy[:] = array.ravel()
    return copy


def _energy(six: kernels.Six) -> float:
    return sum(float(dr.sum(value)[0]) for value in six)


def _vector(xyz: Vector | np.ndarray) -> Any:
    return mi.Vector3f(*(dr.opaque(mi.Float, float(value)) for value in xyz))


def _point(xyz: Vector) -> Any:
    return mi.Point3f(*(dr.opaque(mi.Float, float(value)) for value in xyz))
