"""The air: a lattice-Boltzmann flow in a box, with walls, inlets, open sides and obstacles that may move."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import warp as wp
from pydantic import Field, model_validator

from sixway.bands import RowBands
from sixway.core.config import Config
from sixway.sim.flow import collision, kernels
from sixway.sim.flow.faces import Faces, close_box
from sixway.sim.flow.generated import air, edges
from sixway.sim.flow.generated.pieces import Streaming
from sixway.sim.flow.lattice import CollisionModel, LatticeName, lattice_named, relaxation_time

INSIDE = (slice(1, -1),) * 3
"""The box within its shell."""


Encoding = Literal["populations", "moments"]


class FlowConfig(Config):
    """How the air is computed. smagorinsky: constant of the eddy viscosity, 0 for none; 0.1 is usual."""

    lattice: LatticeName = "D3Q19"
    model: CollisionModel = "regularised"
    smagorinsky: float = Field(default=0.1, ge=0.0, le=0.5)
    streaming: Streaming = "in_place"
    faces: Faces = Faces()
    encoding: Encoding = "populations"
    """What a cell stores: its populations, or the ten moments that they follow from (Li et al. 2023), which asks for
    lattice D3Q27, model third_order and streaming two_grids."""

    @model_validator(mode="after")
    def _model_fits_lattice(self) -> "FlowConfig":
        collision.text(lattice_named(self.lattice), self.model)  # ValueError if the model needs the other lattice
        return self

    @model_validator(mode="after")
    def _can_be_encoded(self) -> "FlowConfig":
        wanted = ("D3Q27", "third_order", "two_grids")
        if self.encoding == "moments" and (self.lattice, self.model, self.streaming) != wanted:
            raise ValueError(
                f"lattice={self.lattice!r}, model={self.model!r}, streaming={self.streaming!r}: ten moments "
                f"stand for {wanted} alone; set these, or store populations"
            )
        return self


class Flow:
    """The air in a box of [z, y, x] cells, at rest at first. Arrays have a shell of one ghost cell on every side.

    Write into the arrays; they stay the same ones, since the launches of a step are recorded.

    kind: FLUID, SOLID, INLET in the box; what the faces make of the shell. Written by `set_solid`, `set_inlets`.
    imposed: velocity of what is no air [cells/step]: of obstacles and walls, and of INLET cells. Write those of
        INLET cells before a step; `set_solid` writes those of obstacles.
    force: acceleration (x, y, z) [3, z, y, x] [cells/step^2]. `update_velocity` needs the force of the last step, so
        write it afterwards.
    growth: gas that fire adds to each cell [1/step], float32 [z, y, x] with shell, or None; it comes with the air's own
        velocity. A small s makes div u = s once the weak sound of it has left.
    velocity, density: of the air at the last `update_velocity`; walls and inlets have what is imposed, the shell of
        the other sides what lies beyond.
    """

    encoding: ClassVar[Encoding] = "populations"

    def __init__(
        self, config: FlowConfig, *, shape_zyx: tuple[int, int, int], viscosity: float, device: str, threads: int = 1
    ) -> None:
        """viscosity: kinematic [cells^2/step].

        Raises ValueError if it is negative, if the box has no cells, or for an encoding that is another class's.
        """
        if config.encoding != self.encoding:
            raise ValueError(
                f"encoding={config.encoding!r}: {type(self).__name__} stores {self.encoding}; "
                "make the flow by sixway.extras.moments.make_flow, which knows both"
            )
        if not viscosity >= 0.0:
            raise ValueError(f"viscosity={viscosity}: air has at least 0 cells^2/step")
        if min(shape_zyx) < 1:
            raise ValueError(f"shape_zyx={shape_zyx}: a box has at least one cell along each axis")
        self.config = config
        self.steps = 0
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)
        self._tau = relaxation_time(viscosity)
        self._shape = tuple(n + 2 for n in shape_zyx)

        kind, imposed = close_box(config.faces, shape_zyx)
        self.kind = wp.array(kind, dtype=wp.int32, device=self._device)
        self.imposed = wp.array(imposed, dtype=wp.vec3, device=self._device)
        self.force = self._zeros((3, *self._shape), wp.float32)
        self.velocity = wp.clone(self.imposed)
        self.density = wp.ones(self._shape, dtype=wp.float32, device=self._device)
        self.growth: wp.array | None = None
        self._kind_without_solid = wp.clone(self.kind)
        self._links = wp.zeros_like(self.kind)
        self._uncovered = wp.zeros_like(self.kind)
        self._refilled = wp.clone(self.density)

        grid = self._zeros((self._planes, _plane_floats(self.kind.size)), wp.float32)
        self._grids = (grid, grid if config.streaming == "in_place" else wp.zeros_like(grid))
        self._find_links()

    def step(self, count: int = 1) -> None:
        """Move the air by `count` steps, the force and the imposed velocities as they are."""
        for _ in range(count):
            send, collide_and_stream = self._launches[self.steps % 2]
            send()
            collide_and_stream()
            self.steps += 1
            if self.growth is not None:
                self._grow(self.growth)

    def _grow(self, growth: wp.array) -> None:
        inside = tuple(n - 2 for n in self._shape)
        kernel = air.grow(self.config.lattice, self.config.streaming)
        self._launch(kernel, inside, [self.kind, growth, *self._sent])

    def update_velocity(self) -> None:
        """Write `velocity` and `density` as the last step left them."""
        kernel = air.measure(self.config.lattice, self.config.streaming)
        inputs = [self.kind, self.imposed, self.force, *self._sent, self._row]
        self._launch(kernel, self._rows, inputs, [self.density, self.velocity])
        self._launch(kernels.extend, self._shape[:2], [self.kind, self.imposed], [self.density, self.velocity])

    def set_flow(self, *, velocity: np.ndarray | Sequence[float], density: np.ndarray | float = 1.0) -> None:
        """Put all air into the equilibrium of a velocity [z, y, x, 3] [cells/step] and a density [z, y, x].

        Both without the shell, or one value for all cells.
        """
        inside = tuple(n - 2 for n in self._shape)
        densities = np.ones(self._shape, dtype=np.float32)
        densities[INSIDE] = density
        wind = np.zeros((*self._shape, 3), dtype=np.float32)
        wind[INSIDE] = np.broadcast_to(np.asarray(velocity), (*inside, 3))
        chosen = wp.ones(self._shape, dtype=wp.int32, device=self._device)
        self._fill(chosen, self._put(densities, wp.float32), self._put(wind, wp.vec3))

    def set_inlets(self, inlet: wp.array) -> None:
        """Make cells INLET where `inlet` [z, y, x] int32, with shell, is not 0; in the shell instead of the side.

        `imposed` holds their velocity. Obstacles placed later go before them. Waits for the device. ValueError if the
        shape does not fit or an inlet is in a periodic side.
        """
        self._check_shape(inlet=inlet)
        self.config.faces.check_inlets(inlet.numpy())
        self._launch(kernels.place_inlets, self._shape, [inlet, self.kind, self._kind_without_solid])
        self._find_links()

    def set_solid(self, solid: wp.array, wall_velocity: wp.array) -> None:
        """Place obstacles: `solid` [z, y, x] int32, 1 within, `wall_velocity` vec3 [cells/step], both with shell.

        For moving bodies call it every frame. Air that a body covers is dropped; where it lets go, the air has the
        velocity that the body had there and the density of the air around it at the last `update_velocity`. The
        shell stays as it is. ValueError if a shape does not fit.
        """
        self._check_shape(solid=solid, wall_velocity=wall_velocity)
        inputs = [solid, wall_velocity, self._kind_without_solid, self.kind, self.imposed, self._uncovered]
        self._launch(kernels.place_solid, self._shape, inputs)
        inputs = [self.kind, self._uncovered, self.density, self._refilled]
        self._launch(kernels.density_around, self._shape, inputs)
        self._fill(self._uncovered, self._refilled, self.imposed)
        self._find_links()

    def force_on_solid(self) -> np.ndarray:
        """Force of the air on all obstacles together in the coming step, (x, y, z) [cells^4/step^2], float64.

        Momentum exchange at half-way walls, Galilean invariant (Wen et al. 2014); the still air's pressure, which
        has no resultant on a closed body, is left out. Waits for the device.
        """
        kernel = edges.exchange(self.config.lattice, self.config.streaming)
        rows = self._zeros(self._shape[:2], wp.vec3)
        self._launch(kernel, self._shape[:2], [self.kind, self._links, self.imposed, *self._sent], [rows])
        return rows.numpy().astype(np.float64).sum(axis=(0, 1))

    def populations(self) -> np.ndarray:
        """What each cell sends in the coming step, g = f - w [q, z, y, x]; of cells that are no air, unsettled."""
        planes = self._by_cell(self._grid)
        if self.config.streaming == "two_grids":
            return planes.copy()
        lattice = lattice_named(self.config.lattice)
        sent = np.empty_like(planes)
        for q, (x, y, z) in enumerate(lattice.velocities):
            plane = planes[q if q == 0 or self.steps % 2 else lattice.opposite[q]]
            sent[q] = np.roll(plane, (-z, -y, -x), axis=(0, 1, 2)) if q % 2 else plane
        return sent

    def state(self) -> dict[str, np.ndarray]:
        """All that `restore` needs to go on with the same bytes. Waits for the device."""
        arrays = {name: array.numpy().copy() for name, array in self._state_arrays().items()}
        return arrays | {"populations": arrays["populations"].reshape(-1), "steps": np.array(self.steps)}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Go on from a `state` of a flow of the same config and shape; ValueError if an array does not fit."""
        for name, array in self._state_arrays().items():
            held = array.numpy()
            wanted = (held.size,) if name == "populations" else held.shape
            if name not in state or state[name].shape != wanted:
                found = state[name].shape if name in state else "nothing"
                raise ValueError(
                    f"state {name!r} is {found}, this flow's is {wanted}: restore with the config and the shape that "
                    "the state was made with"
                )
        self.steps = int(state["steps"])  # says which grid is meant
        for name, array in self._state_arrays().items():
            array.assign(state[name].reshape(array.numpy().shape))
        self._find_links()

    def _state_arrays(self) -> dict[str, wp.array]:
        return {
            "populations": self._grid,
            "kind": self.kind,
            "kind_without_solid": self._kind_without_solid,
            "imposed": self.imposed,
            "force": self.force,
            "velocity": self.velocity,
            "density": self.density,
        }

    @cached_property
    def _launches(self) -> list[list[Callable[[], None]]]:
        """The two halves of a step, of an even step and of an odd one."""
        name, streaming = self.config.lattice, self.config.streaming
        send = edges.send(name, streaming)
        collide_and_stream = air.collide_and_stream(name, self.config.model, streaming)
        launches = []
        for parity, (grid, after) in enumerate((self._grids, self._grids[::-1])):
            edge = [self.kind, self._links, self.imposed, grid, parity, self._row_with_shell]
            cells = [self.kind, self.force, grid, after, parity]
            rates = [self._tau, self.config.smagorinsky, self._row]
            launches.append(
                [
                    self._bands.record(send, dim=self._rows_with_shell, inputs=edge, outputs=[]),
                    self._bands.record(collide_and_stream, dim=self._rows, inputs=[*cells, *rates], outputs=[]),
                ]
            )
        return launches

    def _find_links(self) -> None:
        self._launch(edges.find_links(self.config.lattice), self._shape, [self.kind, self._links])

    def _fill(self, chosen: wp.array, density: wp.array, velocity: wp.array) -> None:
        kernel = air.fill(self.config.lattice, self.config.streaming)
        inside = tuple(n - 2 for n in self._shape)
        self._launch(kernel, inside, [chosen, density, velocity, *self._sent])

    @property
    def _sent(self) -> list[object]:
        """What the kernels need to find the populations that the last step sent."""
        return [self._grid, self.steps % 2]

    @property
    def _grid(self) -> wp.array:
        """[plane, place]: of two axes, since the length of one alone must stay below 2^31 on Warp."""
        return self._grids[self.steps % 2]

    @property
    def _planes(self) -> int:
        return len(lattice_named(self.config.lattice).weights)

    def _by_cell(self, grid: wp.array) -> np.ndarray:
        """Planes of a grid as [plane, z, y, x], without what pads them."""
        return grid.numpy()[:, : self.kind.size].reshape(-1, *self._shape)

    @property
    def _row(self) -> int:
        """Cells of the box that one thread takes: a row, which a CPU vectorises, or on CUDA one."""
        return self._shape[2] - 2 if self._device.is_cpu else 1

    @property
    def _rows(self) -> tuple[int, int, int]:
        z, y, x = self._shape
        return z - 2, y - 2, (x - 2) // self._row

    @property
    def _row_with_shell(self) -> int:
        return self._shape[2] if self._device.is_cpu else 1

    @property
    def _rows_with_shell(self) -> tuple[int, int, int]:
        z, y, x = self._shape
        return z, y, x // self._row_with_shell

    def _check_shape(self, **arrays: wp.array) -> None:
        for name, array in arrays.items():
            if array.shape != self._shape:
                raise ValueError(f"{name} is {array.shape}: it must be {self._shape}, the box with a shell of one cell")

    def _put(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=self._device)

    def _zeros(self, shape: tuple[int, ...], dtype: type) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)

    def _launch(
        self, kernel: wp.Kernel, dim: tuple[int, ...], inputs: list[object], outputs: Sequence[wp.array] = ()
    ) -> None:
        self._bands.launch(kernel, dim=dim, inputs=inputs, outputs=list(outputs))


MakeFlow = Callable[..., Flow]
"""Called as the class `Flow`: what an entry point hands in, which may know more encodings than populations."""


def _plane_floats(cells: int) -> int:
    """Floats between two populations of a cell: whole cache lines, and not a multiple of a page.

    Else the 19 streams of a row would fall into the same few sets of the cache.
    """
    lines = -(-cells // 16)
    return 16 * (lines + (5 - lines) % 64)
