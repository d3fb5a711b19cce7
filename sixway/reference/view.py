"""One volume seen by one camera, on the device: where everything is, and rays through the pixels."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, TO_LIGHT
from sixway.core.frames import SUBPIXELS, Camera, Grid, Vector
from sixway.reference import kernels
from sixway.reference.media import Extinction

SIX_LIGHTS = tuple(TO_LIGHT[name] for name in DIRECTIONS)


class View:
    """What a march or a path needs to know; every number is opaque, so that no new one compiles a kernel.

    to_lights: six unit vectors towards the lights in the CAMERA frame; the six maps need the six axes,
    other sets serve audits such as the white furnace. divisions: of a pixel's edge, sub-pixels being looked at.
    """

    def __init__(
        self,
        extinction: Extinction,
        camera: Camera,
        to_lights: Sequence[Vector] = SIX_LIGHTS,
        *,
        divisions: int = SUBPIXELS,
    ) -> None:
        grid = extinction.grid
        self.camera = camera
        self._divisions = divisions
        self.shape_zyx = grid.shape_zyx
        self.box = box_of(grid)
        self.to_lights = [vector(camera.to_world(to_light)) for to_light in to_lights]
        self._extinction = extinction
        self._eye = point(camera.position_m)
        self._backward = vector(camera.to_viewer)
        self._is_pinhole = dr.opaque(mi.Float, float(camera.kind == "perspective"))
        right, up, _ = camera.basis
        self._right, self._up = vector(right * camera.half_width_m), vector(up * camera.half_height_m)
        self._forward = vector(-camera.basis[2] * camera.distance_m)
        self._width = dr.opaque(mi.UInt32, camera.width_px)
        self._pixel_u = dr.opaque(mi.Float, 2.0 / camera.width_px)
        self._pixel_v = dr.opaque(mi.Float, 2.0 / camera.height_px)

    @cached_property
    def sigma_t(self) -> Any:
        """Extinction [1/m] as a texture of one channel, for those who march through nothing else."""
        return grid_on_device(self._extinction.sigma_t)

    def to_camera(self, points):
        """Unit vectors from world points towards the camera."""
        return dr.select(self._is_pinhole > 0.5, dr.normalize(self._eye - points), self._backward)

    def rays(self, x_px, y_px):
        """Origins and unit vectors of the camera rays through points of the image, in pixels from its top left."""
        u, v = x_px * self._pixel_u - 1.0, 1.0 - y_px * self._pixel_v
        on_plane = self._right * u + self._up * v
        return self._eye + (1.0 - self._is_pinhole) * on_plane, dr.normalize(
            self._is_pinhole * on_plane + self._forward
        )

    def subpixels(self):
        """Upper left corner [px] of the sub-pixels, those of a pixel together, and their number in the pixel."""
        count = self._divisions * self._divisions
        index = dr.arange(mi.UInt32, self.camera.width_px * self.camera.height_px * count)
        sub, pixel = index % count, index // count
        x = mi.Float(pixel % self._width) + mi.Float(sub % self._divisions) / self._divisions
        y = mi.Float(pixel // self._width) + mi.Float(sub // self._divisions) / self._divisions
        return x, y, sub

    def march_rays(self):
        """Origins, unit vectors and march offsets of rays through the sub-pixels' centres.

        The offsets of a pixel's rays divide the step evenly, in an order that does not follow the rows.
        """
        count = self._divisions * self._divisions
        x, y, sub = self.subpixels()
        origin, ray = self.rays(x + 0.5 / self._divisions, y + 0.5 / self._divisions)
        return origin, ray, (mi.Float((sub * 7) % count) + 0.5) / count

    def image(self, channels: list) -> Float[np.ndarray, "h w c"]:
        """The mean over every pixel's sub-pixels, one channel per array, float32."""
        dr.eval(channels)  # in one kernel: each block_sum would compute everything again
        pixels = [dr.block_sum(value, self._divisions**2) / self._divisions**2 for value in channels]
        dr.eval(pixels)
        size = (self.camera.height_px, self.camera.width_px)
        return np.stack([np.array(value, dtype=np.float32).reshape(size) for value in pixels], axis=-1)


def grid_on_device(*fields: Float[np.ndarray, "z y x"]) -> Any:
    """A texture with one channel per field."""
    shape = (*fields[0].shape, len(fields))
    return kernels.grid_texture(mi.TensorXf(mi.Float(aligned(np.stack(fields, axis=-1))), shape))


def aligned(array: np.ndarray) -> np.ndarray:
    """A flat copy that starts at a multiple of 64 bytes.

    Dr.Jit uses NumPy's memory as it is, and compiles one kernel for aligned and another for other loads.
    """
    raw = np.empty(array.nbytes + 64, np.uint8)
    start = -raw.ctypes.data % 64
    copy = raw[start : start + array.nbytes].view(array.dtype)
    copy[:] = array.ravel()
    return copy


def box_of(grid: Grid) -> kernels.Box:
    return kernels.Box(
        origin=point(grid.origin_m), extent=vector(grid.extent_m), voxel=dr.opaque(mi.Float, grid.voxel_size_m)
    )


def vector(xyz: Vector | np.ndarray) -> Any:
    return mi.Vector3f(*(dr.opaque(mi.Float, float(value)) for value in xyz))


def point(xyz: Vector | np.ndarray) -> Any:
    return mi.Point3f(*(dr.opaque(mi.Float, float(value)) for value in xyz))
