"""Solid bodies as cells of the flow and as fractions of smoke voxels, drawn on the device wherever they move."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.frames import Grid
from sixway.sim.bodies import voxelise_kernels as kernels
from sixway.sim.bodies.distance_field import distance_field
from sixway.sim.bodies.shapes import Body, BoxBody, CapsuleBody, CylinderBody, MeshBody, SphereBody
from sixway.sim.units import LatticeUnits

Region = tuple[np.ndarray, np.ndarray]
"""First and behind-last array index (x, y, z) of a part of a grid."""

_WORTH_THREADS = 100_000
"""Voxels below which handing bands to threads costs more than it saves: about half a millisecond."""


class ObstacleField:
    """What the solvers need to know of the bodies, kept up to date by `update`.

    Where bodies overlap, a moving one covers those at rest and a later one those before it. A body may reach past
    the box: the shell is drawn like the cells within.
    Raises ValueError for a mesh that `distance_field` refuses; `shapes.check_bodies` refuses what moves too far or
    too fast.

    moving: whether any body moves; if none does, there is no need to call `update`.
    solid: [z + 2, y + 2, x + 2] int32, velocity grid with its shell: 1 where a cell's centre is inside a body.
    wall_velocity: the same shape, vec3 [cells/step]: velocity + omega x r of the body at solid cells, 0 elsewhere.
    fraction: [z, y, x] float32 in [0, 1], density grid: solid part of each voxel, a ramp one voxel wide.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        *,
        velocity_grid: Grid,
        density_grid: Grid,
        units: LatticeUnits,
        device: str,
        threads: int = 1,
    ) -> None:
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)
        self._alone = RowBands(self._device, threads=1)
        self._cells = _Layer(velocity_grid, shell=1)
        self._voxels = _Layer(density_grid, shell=0)
        self._units = units
        self._resting = [_Drawable(body, self._device) for body in bodies if body.motion is None]
        self._moving = [_Drawable(body, self._device) for body in bodies if body.motion is not None]
        self.moving = bool(self._moving)
        self.solid = wp.zeros(self._cells.shape_zyx, dtype=wp.int32, device=self._device)
        self.wall_velocity = wp.zeros(self._cells.shape_zyx, dtype=wp.vec3, device=self._device)
        self.fraction = wp.zeros(self._voxels.shape_zyx, dtype=wp.float32, device=self._device)
        for body in self._resting:
            self._draw(body, 0.0, self._cells.region(body.body, 0.0), self._voxels.region(body.body, 0.0))
        self._drawn: list[tuple[Region, Region]] = []
        self.update(0.0)

    def update(self, time_s: float) -> None:
        """Draw the moving bodies where they are at `time_s`; what they uncover is drawn as it was before."""
        for cells, voxels in self._drawn:
            self._clear(cells, voxels)
        for cells, voxels in self._drawn:
            for body in self._resting:
                at_cells, at_voxels = self._cells.region(body.body, 0.0), self._voxels.region(body.body, 0.0)
                self._draw(body, 0.0, _common(cells, at_cells), _common(voxels, at_voxels))
        self._drawn = []
        for body in self._moving:
            cells, voxels = self._cells.region(body.body, time_s), self._voxels.region(body.body, time_s)
            self._draw(body, time_s, cells, voxels)
            self._drawn.append((cells, voxels))

    def _draw(self, drawable: "_Drawable", time_s: float, cells: Region, voxels: Region) -> None:
        body, field = drawable.body, drawable.field
        pose = body.pose(time_s)
        centre = self._cells.index(body.placement(time_s)[0])
        velocity = pose.velocity_m_s * self._units.dt_s / self._units.dx_m
        spin = pose.spin_rad_s * self._units.dt_s
        motion = [wp.vec3(*centre), wp.vec3(*velocity), wp.vec3(*spin)]
        solid = drawable.on(self._cells, time_s)
        self._launch(kernels.draw_solid, cells, [solid, field, *motion], [self.solid, self.wall_velocity])
        solid = drawable.on(self._voxels, time_s)
        self._launch(kernels.draw_fraction, voxels, [solid, field], [self.fraction])

    def _clear(self, cells: Region, voxels: Region) -> None:
        self._launch(kernels.clear_solid, cells, [], [self.solid, self.wall_velocity])
        self._launch(kernels.clear_fraction, voxels, [], [self.fraction])

    def _launch(self, kernel: wp.Kernel, region: Region, inputs: list[Any], outputs: list[wp.array]) -> None:
        first, behind = region
        x, y, z = (int(n) for n in behind - first)
        if min(x, y, z) > 0:
            bands = self._bands if x * y * z > _WORTH_THREADS else self._alone
            bands.launch(kernel, dim=(z, y, x), inputs=[wp.vec3i(*first.tolist()), *inputs], outputs=outputs)


class _Layer:
    """A grid with its shell, as an array that bodies are drawn into."""

    def __init__(self, grid: Grid, *, shell: int) -> None:
        self.voxel_m = grid.voxel_size_m
        self.shape_zyx = tuple(n + 2 * shell for n in grid.shape_zyx)
        self._first_centre_m = np.array(grid.origin_m) + (0.5 - shell) * grid.voxel_size_m

    def index(self, point_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Array index (x, y, z) of a world position; whole at centres of voxels."""
        return (point_m - self._first_centre_m) / self.voxel_m

    def region(self, body: Body, time_s: float) -> Region:
        """The part of the array that the body may touch, with its ramp."""
        low, high = (self.index(corner) for corner in body.bounds_m(time_s))
        size = np.array(self.shape_zyx[::-1])
        first = np.clip(np.floor(low - 0.5), 0, size).astype(int)
        behind = np.clip(np.ceil(high + 0.5) + 1, 0, size).astype(int)
        return first, behind


class _Drawable:
    """A body with the constants that kernels draw it by."""

    def __init__(self, body: Body, device: wp.Device) -> None:
        self.body = body
        self.field = wp.zeros((2, 2, 2), dtype=wp.float32, device=device)
        self._spacing_m = 1.0
        self._half_m = body.half_extent_m
        match body:
            case SphereBody():
                self._kind, self._half_m = kernels.CAPSULE, np.array([body.radius_m, 0.0, 0.0])
            case CapsuleBody():
                self._kind, self._half_m = kernels.CAPSULE, np.array([body.radius_m, 0.0, 0.5 * body.length_m])
            case CylinderBody():
                self._kind = kernels.CYLINDER
            case BoxBody():
                self._kind = kernels.BOX
            case MeshBody():
                field = distance_field(body.surface, body.resolution)
                self.field = wp.array(field.values / field.spacing, dtype=wp.float32, device=device)
                self._kind, self._spacing_m = kernels.FIELD, field.spacing * body.size_m
                self._half_m = field.half_extent * body.size_m
            case _:
                raise AssertionError(f"no kernel draws a {type(body).__name__}")

    def on(self, layer: _Layer, time_s: float) -> kernels.Solid:
        """The body at a time in the units and axes of an array."""
        centre, rotation = self.body.placement(time_s)
        solid = kernels.Solid()
        solid.kind = self._kind
        solid.half = wp.vec3(*(self._half_m / layer.voxel_m))
        solid.spacing = self._spacing_m / layer.voxel_m
        solid.to_body = wp.mat33(rotation.T)
        solid.shift = wp.vec3(*(-rotation.T @ layer.index(centre)))
        return solid


def _common(a: Region, b: Region) -> Region:
    return np.maximum(a[0], b[0]), np.minimum(a[1], b[1])
