"""What pushes the air: smoke that weighs, heat that lifts, and the swirl that a coarse grid would lose."""

from collections.abc import Mapping

import warp as wp

from sixway.bands import RowBands
from sixway.sim.carried import forces_kernels
from sixway.sim.carried.scalars import Scalars


class Forces:
    """Writes the acceleration of the air, lattice units [cells/step^2].

    lifts: upward (+y) acceleration for each unit of a field; negative for what is heavier than air. Boussinesq: a
    temperature above ambient dT lifts by g dT / T_ambient, so its lift is g / T_ambient in cells/step^2 a kelvin.

    confinement: epsilon of Fedkiw, Stam & Jensen 2001, Eqs. 9 to 11, as a rate [1/step]: f = epsilon h (N x omega) with
    h = 1 cell. A unitless strength that means the same on every grid and at every time step is epsilon times the time
    that the air takes through the box: confinement = strength * lattice speed / cells of the longest edge.

    Raises ValueError for a lift of a field that there is not, or a negative confinement.
    """

    def __init__(
        self, scalars: Scalars, *, lifts: Mapping[str, float], confinement: float, device: str, threads: int = 1
    ) -> None:
        unknown = sorted(set(lifts) - set(scalars.names))
        if unknown:
            raise ValueError(f"lifts name {unknown}, but the fields are {scalars.names}; name one of them")
        if not confinement >= 0.0:
            raise ValueError(f"confinement {confinement} would calm swirls; give 0 or more")
        self._scalars = scalars
        self._confinement = confinement
        self._device = wp.get_device(device)
        self._bands = RowBands(self._device, threads=threads)
        self._lifts = wp.array([lifts.get(name, 0.0) for name in scalars.names], dtype=wp.float32, device=self._device)
        z, y, x = (n // scalars.refinement for n in scalars.shape_zyx)
        self._cells = (z, y, x)
        self._vorticity = wp.zeros((z, y, x), dtype=wp.vec3, device=self._device)

    def update(self, velocity: wp.array, force: wp.array) -> None:
        """Write `force`, float32 [3, z + 2, y + 2, x + 2], inside its shell; no wait for the device.

        velocity: vec3 [z + 2, y + 2, x + 2], cells/step. Solid cells are not told apart: nothing reads a force there.
        """
        expected = tuple(n + 2 for n in self._cells)
        if tuple(velocity.shape) != expected or tuple(force.shape) != (3, *expected):
            raise ValueError(
                f"velocity {velocity.shape} and force {force.shape} must be {expected} and {(3, *expected)}: "
                "the cells with their shell"
            )
        if self._confinement > 0.0:
            self._bands.launch(forces_kernels.curl, dim=self._cells, inputs=[velocity], outputs=[self._vorticity])
        inputs = [self._confinement, self._vorticity, self._lifts, self._scalars.refinement, self._scalars.stacked]
        self._bands.launch(forces_kernels.push, dim=self._cells, inputs=inputs, outputs=[force])
