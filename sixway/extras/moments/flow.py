"""A `Flow` that stores ten moments a cell."""

from collections.abc import Callable
from functools import cached_property
from typing import ClassVar

import numpy as np
import warp as wp

from sixway.extras.moments import generated, kernels
from sixway.sim.flow import kernels as flow_kernels
from sixway.sim.flow.flow import Encoding, Flow
from sixway.sim.flow.generated import edges
from sixway.sim.flow.lattice import D3Q27


class MomentFlow(Flow):
    """A `Flow` of D3Q27 and collision model `third_order` that stores ten moments a cell.

    Equal to its population twin but for rounding; only OPEN and INLET cells differ, in the third order of their
    velocity, and INLET cells send the mean density of the air around them. It passes and fails the same gates as that
    model. It takes in no gas (`growth`).
    """

    encoding: ClassVar[Encoding] = "moments"

    def update_velocity(self) -> None:
        inputs = [self.kind, self.imposed, self.force, self._grid]
        self._launch(kernels.measure, self._shape, inputs, [self.density, self.velocity])
        self._launch(flow_kernels.extend, self._shape[:2], [self.kind, self.imposed], [self.density, self.velocity])

    def moments(self) -> np.ndarray:
        """Density - 1, velocity at the end of the step and stress (xx, yy, zz, xy, xz, yz) of air [10, z, y, x]."""
        return self._by_cell(self._grid).copy()

    def populations(self) -> np.ndarray:
        """What each cell of air sends in the coming step, g = f - w [27, z, y, x]."""
        return self._by_cell(self._expanded()).copy()

    def force_on_solid(self) -> np.ndarray:
        links, rows = wp.zeros_like(self.kind), self._zeros(self._shape[:2], wp.vec3)
        self._launch(edges.find_links("D3Q27"), self._shape, [self.kind, links])
        inputs = [self.kind, links, self.imposed, self._expanded(), 0]
        self._launch(edges.exchange("D3Q27", "two_grids"), self._shape[:2], inputs, [rows])
        return rows.numpy().astype(np.float64).sum(axis=(0, 1))

    @property
    def _planes(self) -> int:
        return len(generated.MOMENTS)

    @cached_property
    def _launches(self) -> list[list[Callable[[], None]]]:
        launches = []
        for grid, after in (self._grids, self._grids[::-1]):
            edge = [self.kind, self.imposed, edges.OPEN_RELAXATION, grid]
            cells = [self.kind, self._links, self.force, grid, after, self._tau, self.config.smagorinsky, self._row]
            step = generated.collide_and_stream()
            launches.append(
                [
                    self._bands.record(kernels.stand_for, dim=self._shape, inputs=edge, outputs=[]),
                    self._bands.record(step, dim=self._rows, inputs=cells, outputs=[]),
                ]
            )
        return launches

    def _expanded(self) -> wp.array:
        """Populations of all cells, in planes as `Flow` has them with two grids."""
        grid = self._zeros((len(D3Q27.weights), self._grid.shape[1]), wp.float32)
        self._launch(generated.expand(), (self.kind.size,), [self._grid, grid])
        return grid

    def _find_links(self) -> None:
        self._launch(kernels.find_walls, self._shape, [self.kind, self._links])

    def _fill(self, chosen: wp.array, density: wp.array, velocity: wp.array) -> None:
        inside = tuple(n - 2 for n in self._shape)
        self._launch(kernels.fill, inside, [chosen, density, velocity, self._grid])
