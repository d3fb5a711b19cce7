"""What the air carries: smoke, heat, fuel, on a grid as fine as the velocity's or finer."""

import math
from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np
import warp as wp

from sixway.bands import RowBands
from sixway.sim.carried import advection_kernels, scalar_kernels, survey_kernels
from sixway.sim.flow.faces import SIDES, Side

Scheme = Literal["cubic", "linear"]
FaceKind = Literal["closed", "open", "periodic"]
_KINDS = {"closed": advection_kernels.CLOSED, "open": advection_kernels.OPEN, "periodic": advection_kernels.PERIODIC}
MOST_FIELDS = 30


class Scalars:
    """Fields of one grid that move with the air, all zero at first.

    names: of the fields. shape_zyx: cells of the velocity grid, without its shell. refinement: voxels along the edge
    of a cell, 1, 2 or 4. faces: kinds of the box's faces, "closed" where not named; through an "open" one air without
    any smoke, heat or fuel comes in. floor: absolute values up to it become 0 when they are carried, so that smoke has
    an end and empty space can be skipped. threads: CPU threads; they change no byte.

    scheme: semi-Lagrangian, traced back by the midpoint rule. "cubic", Catmull-Rom in each axis clamped to the eight
    voxels around the departure point; "linear" (Stam 1999), which blurs. Neither conserves mass: `mass()` tells what
    there is.

    Obstacles hold no smoke, block the backtrace, and take no part in interpolation (the voxels beside them are read
    trilinearly). The backtrace sees them where they stood when the fields were last carried (nowhere, at first): so
    the air before a moving one takes its smoke along. What an obstacle overtakes is lost, and `mass()` tells how much.
    A wall two voxels thick is tight.

    Raises ValueError for a refinement, scheme, name or face that is none.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        *,
        shape_zyx: tuple[int, int, int],
        refinement: int,
        scheme: Scheme = "cubic",
        faces: Mapping[Side, FaceKind] | None = None,
        floor: float = 1e-6,
        device: str,
        threads: int = 1,
    ) -> None:
        if not 1 <= len(names) <= MOST_FIELDS or len(set(names)) != len(names):
            raise ValueError(f"field names {names} must be 1 to {MOST_FIELDS} different names; rename or drop some")
        if refinement not in (1, 2, 4):
            raise ValueError(f"refinement {refinement} must be 1, 2 or 4 voxels a cell; choose one of them")
        if scheme not in get_args(Scheme):
            raise ValueError(f"scheme {scheme!r} is not known; choose cubic or linear")
        if not (math.isfinite(floor) and floor >= 0.0):
            raise ValueError(f"floor {floor} must be finite and not negative; 0 keeps every value")
        self.names = names
        self.refinement = refinement
        self.scheme = scheme
        self._faces = _face_kinds(faces or {})
        self._floor = floor
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)

        z, y, x = shape_zyx
        self.shape_zyx = (z * refinement, y * refinement, x * refinement)
        blocks = tuple(-(-n // survey_kernels.BLOCK) for n in self.shape_zyx)
        self._now = self._zeros((len(names), *self.shape_zyx), wp.float32)
        self._next = wp.zeros_like(self._now)
        self._solid = self._zeros(self.shape_zyx, wp.uint8)
        self._solid_next = wp.zeros_like(self._solid)
        self._no_obstacles = self._zeros((0, 0, 0), wp.float32)
        self._flags = self._zeros(blocks, wp.int32)
        self._spread_flags = wp.zeros_like(self._flags)
        self._cells = (z + 2, y + 2, x + 2)
        self._fastest_in_rows = self._zeros((z + 2, y + 2), wp.float32)
        self._fastest_in_layers = self._zeros((1, z + 2), wp.float32)
        self._fastest = self._zeros((1,), wp.float32)

    @property
    def fields(self) -> dict[str, wp.array]:
        """Each field now, float32 [z, y, x]; they move to other memory when carried, so ask again."""
        return {name: self._now[number] for number, name in enumerate(self.names)}

    @property
    def stacked(self) -> wp.array:
        """All fields now in the order of `names`, float32 [field, z, y, x]; ask again as for `fields`."""
        return self._now

    def advect(self, velocity: wp.array, *, steps: float, solid_fraction: wp.array | None = None) -> None:
        """Carry all fields along the wind for `steps` lattice steps; no wait for the device.

        velocity: vec3 [z + 2, y + 2, x + 2], cells/step, with the shell, which holds what is outside: the walls'
        velocity, or on periodic faces a copy of the opposite cells. solid_fraction: part of each voxel that obstacles
        fill, [z, y, x] of this grid, in [0, 1]; from 0.5 on the voxel is solid.
        Raises ValueError if a shape does not fit.
        """
        if tuple(velocity.shape) != self._cells:
            raise ValueError(f"velocity of shape {velocity.shape} must be {self._cells}: the cells with their shell")
        if solid_fraction is not None and tuple(solid_fraction.shape) != self.shape_zyx:
            raise ValueError(f"solid_fraction of shape {solid_fraction.shape} must be {self.shape_zyx}, the voxels")
        self._survey(velocity, steps, self._no_obstacles if solid_fraction is None else solid_fraction)
        scheme = advection_kernels.CUBIC if self.scheme == "cubic" else advection_kernels.LINEAR
        reach = [float(self.refinement), float(steps), self._faces]
        self._launch_voxels(
            advection_kernels.advect,
            [velocity, self._solid, self._solid_next, self._flags, *reach, scheme, self._floor, self._now],
            self._next,
        )
        self._now, self._next = self._next, self._now
        self._solid, self._solid_next = self._solid_next, self._solid

    def feed(self, name: str, source: wp.array) -> None:
        """Raise a field to `source`, float32 [z, y, x], wherever it is lower and no obstacle stands."""
        inputs = [source.flatten(), self._solid.flatten()]
        self._launch_flat(scalar_kernels.feed, inputs, name)

    def dissipate(self, name: str, *, rate_per_s: float, seconds: float) -> None:
        """Let a field fade by exp(-rate_per_s * seconds)."""
        if rate_per_s < 0.0:
            raise ValueError(f"rate_per_s={rate_per_s} would make {name} grow; give 0 or more")
        if rate_per_s > 0.0:
            self._launch_flat(scalar_kernels.scale, [math.exp(-rate_per_s * seconds)], name)

    def cool(
        self,
        name: str,
        *,
        rate_per_s: float,
        radiation_k_per_s: float = 0.0,
        hottest_k: float = 1000.0,
        seconds: float,
    ) -> None:
        """Let a temperature [K above ambient] fall, dT/dt = -rate T - radiation (T / hottest)^4.

        rate_per_s: by mixing and conduction. radiation_k_per_s: how fast gas at `hottest_k` cools by radiation; the
        fourth power of Feldman et al. 2003, Eq. 4. Both are solved exactly, one after the other.
        """
        if min(rate_per_s, radiation_k_per_s) < 0.0 or hottest_k <= 0.0:
            raise ValueError(
                f"rate_per_s={rate_per_s}, radiation_k_per_s={radiation_k_per_s} and hottest_k={hottest_k} would "
                "heat; the rates must be 0 or more and hottest_k positive"
            )
        factor = math.exp(-rate_per_s * seconds)
        radiated = 3.0 * radiation_k_per_s * seconds / hottest_k**4
        if factor < 1.0 or radiated > 0.0:
            self._launch_flat(scalar_kernels.cool, [factor, radiated], name)

    def mass(self) -> dict[str, float]:
        """Sum of each field over all voxels [voxels]; waits for the device."""
        return {name: float(field.numpy().sum(dtype=np.float64)) for name, field in self.fields.items()}

    def state(self) -> dict[str, np.ndarray]:
        """All that the next step depends on: one array a field, and where obstacles stand."""
        fields = {f"scalar.{name}": field.numpy().copy() for name, field in self.fields.items()}
        return {**fields, "scalar_solid": self._solid.numpy().copy()}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from `state()`, bit for bit. Raises ValueError if it is of other fields or another grid."""
        wanted = {**{f"scalar.{name}": np.float32 for name in self.names}, "scalar_solid": np.uint8}
        for key, dtype in wanted.items():
            if key not in state or state[key].shape != self.shape_zyx or state[key].dtype != dtype:
                found = f"{state[key].dtype} {state[key].shape}" if key in state else "nothing"
                raise ValueError(
                    f"state {key!r} must be {np.dtype(dtype)} {self.shape_zyx}, got {found}; "
                    "restore a state of the same scenario"
                )
        for name, field in self.fields.items():
            field.assign(state[f"scalar.{name}"])
        self._solid.assign(state["scalar_solid"])

    def _survey(self, velocity: wp.array, steps: float, fraction: wp.array) -> None:
        """Flag the blocks that smoke or walls can reach: the rest is skipped, and stays zero to the bit."""
        z, y, _ = self._cells
        blocks = self._flags.shape
        launch = self._bands.launch
        launch(survey_kernels.fastest_in_rows, dim=(z, y), inputs=[velocity], outputs=[self._fastest_in_rows])
        layers = self._fastest_in_layers
        launch(survey_kernels.greatest_in_rows, dim=(z,), inputs=[self._fastest_in_rows], outputs=[layers.flatten()])
        launch(survey_kernels.greatest_in_rows, dim=(1,), inputs=[layers], outputs=[self._fastest])
        if fraction is self._no_obstacles:
            self._solid_next.zero_()
        launch(
            survey_kernels.survey,
            dim=blocks,
            inputs=[fraction, self._solid, self._now],
            outputs=[self._solid_next, self._flags],
        )
        for axis in range(3):
            periodic = self._faces[2 * (2 - axis)] == advection_kernels.PERIODIC
            inputs = [axis, periodic, self.refinement * abs(steps), self._fastest, self._flags]
            launch(survey_kernels.spread, dim=blocks, inputs=inputs, outputs=[self._spread_flags])
            self._flags, self._spread_flags = self._spread_flags, self._flags

    def _launch_voxels(self, kernel: wp.Kernel, inputs: list, output: wp.array) -> None:
        z, y, x = self.shape_zyx
        span = (
            x if self._device.is_cpu else 1
        )  # a CPU saves finding out where it is; CUDA needs neighbours side by side
        self._bands.launch(kernel, dim=(z, y, -(-x // span)), inputs=[span, *inputs], outputs=[output])

    def _launch_flat(self, kernel: wp.Kernel, inputs: list, name: str) -> None:
        field = self._now[self.names.index(name)].flatten()
        self._bands.launch(kernel, dim=field.shape, inputs=inputs, outputs=[field])

    def _zeros(self, shape: tuple[int, ...], dtype: type) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self._device)


def _face_kinds(faces: Mapping[Side, FaceKind]) -> advection_kernels.vec6i:
    for face, kind in faces.items():
        if face not in SIDES or kind not in _KINDS:
            raise ValueError(f"face {face!r}: {kind!r} is not known; faces are {SIDES}, kinds {tuple(_KINDS)}")
    kinds = [faces.get(face, "closed") for face in SIDES]
    for low, high in ((0, 1), (2, 3), (4, 5)):
        if (kinds[low] == "periodic") != (kinds[high] == "periodic"):
            raise ValueError(
                f"faces {SIDES[low]} ({kinds[low]}) and {SIDES[high]} ({kinds[high]}) face each other; "
                "make both periodic or neither"
            )
    return advection_kernels.vec6i(*[_KINDS[kind] for kind in kinds])
