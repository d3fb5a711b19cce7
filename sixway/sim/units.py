"""Lattice units and SI: one cell is `dx_m` metres, one lattice step `dt_s` seconds."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class LatticeUnits:
    """The two scales that fix all others. Lattice units never leave `sixway.sim`."""

    dx_m: float
    dt_s: float

    def velocity_to_lattice(self, velocity_m_s: float) -> float:
        """[m/s] to [cells/step]."""
        return velocity_m_s * self.dt_s / self.dx_m

    def viscosity_to_lattice(self, viscosity_m2_s: float) -> float:
        """[m^2/s] to [cells^2/step]."""
        return viscosity_m2_s * self.dt_s / self.dx_m**2

    def acceleration_to_lattice(self, acceleration_m_s2: float) -> float:
        """[m/s^2] to [cells/step^2]."""
        return acceleration_m_s2 * self.dt_s**2 / self.dx_m

    @property
    def velocity_m_s(self) -> float:
        """One cell per step, in m/s: what a lattice velocity is multiplied by."""
        return self.dx_m / self.dt_s
