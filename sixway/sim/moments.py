"""The air as ten moments a cell: the encoding of Li et al. 2023 ("High-order moment-encoded kinetic simulation").

Density, velocity and stress are all that the regularised collision leaves of a cell; its 27 populations follow from
them by a Hermite series of third order. So ten floats a cell are moved instead of 27, for more arithmetic: of use
where memory is short or slow (80 bytes an update, against 216 with D3Q27). On a CPU it is slower than the populations.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
import warp as wp

from sixway.sim import moments_kernels, moments_native
from sixway.sim.flow import collision_oracle, kernels, oracle
from sixway.sim.flow.flow import Flow, FlowConfig
from sixway.sim.flow.generated.edges import OPEN_RELAXATION
from sixway.sim.flow.lattice import D3Q27


def check_moments(config: FlowConfig) -> None:
    """Raise ValueError for a lattice, a model or a streaming that ten moments cannot stand for."""
    wanted = ("D3Q27", "third_order", "two_grids")
    if (config.lattice, config.model, config.streaming) != wanted:
        raise ValueError(
            f"lattice={config.lattice!r}, model={config.model!r}, streaming={config.streaming!r}: ten moments "
            f"stand for {wanted} alone; set these, or store populations"
        )


class MomentFlow(Flow):
    """A `Flow` of D3Q27 and collision model `third_order` that stores ten moments a cell.

    Equal to its population twin but for rounding; only OPEN and INLET cells differ, in the third order of their
    velocity, and INLET cells send the mean density of the air around them. It passes and fails the same gates as that
    model. `force_on_solid` is computed on the host, slowly.
    """

    def __init__(
        self, config: FlowConfig, *, shape_zyx: tuple[int, int, int], viscosity: float, device: str, threads: int = 1
    ) -> None:
        """As `Flow`; ValueError also for a lattice, a model or a streaming that moments cannot stand for."""
        check_moments(config)
        super().__init__(config, shape_zyx=shape_zyx, viscosity=viscosity, device=device, threads=threads)
        cells = len(moments_native.MOMENTS) * self._stride
        self._grids = (self._zeros((cells,), wp.float32), self._zeros((cells,), wp.float32))

    def update_velocity(self) -> None:
        inputs = [self.kind, self.imposed, self.force, self._stride, self._grid]
        self._launch(moments_kernels.measure, self._shape, inputs, [self.density, self.velocity])
        self._launch(kernels.extend, self._shape[:2], [self.kind, self.imposed], [self.density, self.velocity])

    def moments(self) -> np.ndarray:
        """Density - 1, velocity at the end of the step and stress (xx, yy, zz, xy, xz, yz) of air [10, z, y, x]."""
        planes = self._grid.numpy().reshape(-1, self._stride)[:, : self.kind.size]
        return planes.reshape(-1, *self._shape).copy()

    def populations(self) -> np.ndarray:
        """What each cell of air sends in the coming step, g = f - w [27, z, y, x], float64."""
        shift, *v, xx, yy, zz, xy, xz, yz = self.moments().astype(np.float64)
        stress = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        f = collision_oracle.third_order(D3Q27, 1.0 + shift, np.array(v), stress)
        return f - D3Q27.weights[:, None, None, None]

    def force_on_solid(self) -> np.ndarray:
        kind, imposed = self.kind.numpy(), self.imposed.numpy().astype(np.float64)
        return oracle.force_on_solid(D3Q27, kind, imposed, self.populations())

    @cached_property
    def _launches(self) -> list[list[Callable[[], None]]]:
        launches = []
        for grid, after in (self._grids, self._grids[::-1]):
            edge = [self.kind, self.imposed, self._stride, OPEN_RELAXATION, grid]
            cells = [self.kind, self._links, self.force, grid, after, self._stride]
            rates = [self._tau, self.config.smagorinsky, self._row]
            step = moments_native.collide_and_stream()
            launches.append(
                [
                    self._bands.record(moments_kernels.stand_for, dim=self._shape, inputs=edge, outputs=[]),
                    self._bands.record(step, dim=self._rows, inputs=[*cells, *rates], outputs=[]),
                ]
            )
        return launches

    def _find_links(self) -> None:
        self._launch(moments_kernels.find_walls, self._shape, [self.kind, self._links])

    def _fill(self, chosen: wp.array, density: wp.array, velocity: wp.array) -> None:
        inside = tuple(n - 2 for n in self._shape)
        self._launch(moments_kernels.fill, inside, [chosen, density, velocity, self._stride, self._grid])
