"""Light that is kept on the voxels of a grid, where smoke can ask for it, and read anywhere between them."""

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from sixway.reference import kernels
from sixway.reference.media import Extinction, reached
from sixway.reference.view import aligned, box_of

_CHANNELS = 8  # sigma_t, six lights, solid: one packet load per corner of a voxel


class Field:
    """sigma_t, six values of light and the solid fraction anywhere in a box."""

    def __init__(self, texture: Any, box: kernels.Box) -> None:
        self.texture, self.box = texture, box

    def at(self, point, ray=None):
        return self.texture.eval(self.box.to_texture(point))


class DirectionalField:
    """As `Field`, with light that depends on where it goes: a texture for each moment of `kernels.angular`."""

    def __init__(self, moments: list[Field], to_lights: list) -> None:
        self._moments, self._to_lights = moments, to_lights

    def at(self, point, ray):
        """What goes against the ray."""
        fields = self._moments[0].at(point)
        weights = kernels.angular(-ray, self._to_lights)
        for moment, weight in zip(self._moments[1:], weights[1:], strict=True):
            fields[1:7] = [dr.fma(w, b, a) for w, a, b in zip(weight, fields[1:7], moment.at(point)[1:7], strict=True)]
        return fields


class Voxels:
    """The voxels of a grid that hold light, and fields over the whole grid."""

    def __init__(self, extinction: Extinction) -> None:
        grid = extinction.grid
        self.box = box_of(grid)
        self._count = extinction.sigma_t.size
        self._shape = grid.shape_zyx
        self._sigma_t = mi.Float(aligned(extinction.sigma_t))
        self._solid = mi.Float(aligned(extinction.solid))
        active = np.flatnonzero(reached(extinction.sigma_t))
        self.active = mi.UInt32(aligned(active.astype(np.uint32)))
        z, y, x = np.unravel_index(active, grid.shape_zyx)
        place = np.full([size + 2 for size in grid.shape_zyx], -1, np.int32)  # among the active ones; -1 elsewhere
        place[z + 1, y + 1, x + 1] = np.arange(active.size)
        self._place = mi.Int32(aligned(place))
        self._bordered = mi.UInt32(aligned(np.flatnonzero(place >= 0).astype(np.uint32)))
        _, height, width = place.shape
        self.centres = mi.Point3f(
            *(
                mi.Float(aligned(((index + 0.5) * grid.voxel_size_m + origin).astype(np.float32)))
                for index, origin in zip((x, y, z), grid.origin_m, strict=True)
            )
        )
        self._strides = [dr.opaque(mi.UInt32, stride) for stride in (1, width, width * height)]

    def sharpened(self, values: list) -> list:
        """Values whose linear interpolation has the right mean between voxels where the light is curved.

        Light bulges inside smoke, and chords lie below a bulge: without this, every bounce loses some. The
        prefilter is (-1, 14, -1) / 12 along each axis (Condat, Blu, Unser 2005, quasi-interpolation).
        """
        result = list(values)
        for stride in self._strides:
            before, after = (dr.gather(mi.Int32, self._place, self._bordered + offset) for offset in (-stride, stride))
            both = (before >= 0) & (after >= 0)
            for channel, value in enumerate(values):
                curve = dr.gather(mi.Float, value, before, both) + dr.gather(mi.Float, value, after, both) - 2.0 * value
                result[channel] -= dr.select(both, curve / 12.0, 0.0)
        return result  # not clipped at zero, where it overshoots: of noisy values that would raise the mean

    def field(self, six: kernels.Six) -> Field:
        """From six values per active voxel."""
        dr.eval(six)  # in one kernel: each scatter below would run its own
        values = dr.zeros(mi.Float, self._count * _CHANNELS)
        every = dr.arange(mi.UInt32, self._count) * _CHANNELS
        dr.scatter(values, self._sigma_t, every)
        dr.scatter(values, self._solid, every + 7)
        for channel, value in enumerate(six, start=1):
            dr.scatter(values, value, self.active * _CHANNELS + channel)
        return Field(kernels.grid_texture(mi.TensorXf(values, (*self._shape, _CHANNELS))), self.box)
