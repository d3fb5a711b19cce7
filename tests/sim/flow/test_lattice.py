"""The velocity sets and the units."""

import numpy as np
import pytest

from sixway.sim.flow.lattice import D3Q19, D3Q27, SOUND_SPEED, Lattice, relaxation_time
from sixway.sim.units import LatticeUnits


@pytest.mark.parametrize(("lattice", "count"), [(D3Q19, 19), (D3Q27, 27)])
def test_moments_are_isotropic_to_fourth_order(lattice: Lattice, count: int) -> None:
    c, w, eye = lattice.velocities, lattice.weights, np.eye(3)
    assert len(np.unique(c, axis=0)) == count
    np.testing.assert_allclose(w.sum(), 1.0)
    np.testing.assert_allclose(np.einsum("q,qa->a", w, c), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.einsum("q,qa,qb->ab", w, c, c), SOUND_SPEED**2 * eye, atol=1e-15)
    np.testing.assert_allclose(np.einsum("q,qa,qb,qd->abd", w, c, c, c), 0.0, atol=1e-15)
    pairs = np.einsum("ab,de->abde", eye, eye)
    fourth = pairs + pairs.transpose(0, 2, 1, 3) + pairs.transpose(0, 2, 3, 1)
    np.testing.assert_allclose(np.einsum("q,qa,qb,qd,qe->abde", w, c, c, c, c), SOUND_SPEED**4 * fourth, atol=1e-15)


@pytest.mark.parametrize("lattice", [D3Q19, D3Q27])
def test_opposites_are_opposite_and_mirrors_mirror(lattice: Lattice) -> None:
    np.testing.assert_array_equal(lattice.velocities[lattice.opposite], -lattice.velocities)
    mirrored = lattice.velocities[lattice.mirrored((True, False, True))]
    np.testing.assert_array_equal(mirrored, lattice.velocities * (-1, 1, -1))


def test_units_keep_the_reynolds_number() -> None:
    units = LatticeUnits(dx_m=0.02, dt_s=0.1 * 0.02 / 4.0)
    assert units.velocity_to_lattice(4.0) == pytest.approx(0.1)
    assert units.velocity_m_s * 0.1 == pytest.approx(4.0)
    in_si = 4.0 * 0.3 / 1e-3
    on_lattice = 0.1 * (0.3 / 0.02) / units.viscosity_to_lattice(1e-3)
    assert on_lattice == pytest.approx(in_si)
    fall_m = 0.5 * 9.81 * (7 * units.dt_s) ** 2
    assert 0.5 * units.acceleration_to_lattice(9.81) * 7**2 * units.dx_m == pytest.approx(fall_m)
    assert relaxation_time(1 / 6) == pytest.approx(1.0)
