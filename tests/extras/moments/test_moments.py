"""Ten moments a cell against the populations that they stand for, walls, faces and moving obstacles included."""

import numpy as np
import pytest
import warp as wp

from sixway.extras.moments import MomentFlow
from sixway.sim.flow import collision_oracle as oracle
from sixway.sim.flow.faces import Faces, MovingWall
from sixway.sim.flow.flow import Flow, FlowConfig
from sixway.sim.flow.lattice import D3Q27, FLUID, INLET

SHAPE = (9, 10, 11)
LID = MovingWall(velocity=(0.06, 0.0, 0.03))
ROOMS = {
    "walls and a lid": Faces(y_high=LID),
    "periodic": Faces(**{f"{a}_{side}": "periodic" for a in "xyz" for side in ("low", "high")}),
    "slip sides, periodic in z": Faces(x_low="slip", x_high="slip", y_high="slip", z_low="periodic", z_high="periodic"),
}


def config(faces: Faces, **changes) -> FlowConfig:
    twin = {"lattice": "D3Q27", "model": "third_order", "streaming": "two_grids", "encoding": "moments", "faces": faces}
    return FlowConfig(**(twin | changes))


def pair(faces: Faces, device: str, *, viscosity: float = 0.002) -> tuple[MomentFlow, Flow]:
    """Both flows of one config, at rest."""
    kept = {"shape_zyx": SHAPE, "viscosity": viscosity, "device": device}
    return MomentFlow(config(faces), **kept), Flow(config(faces, encoding="populations"), **kept)


def push(flow: Flow, rng: np.random.Generator, strength: float = 0.004) -> None:
    """A force without rhyme or reason, which stirs air at rest within a few steps."""
    flow.force.assign((strength * rng.standard_normal(flow.force.shape)).astype(np.float32))


def compare(moments: MomentFlow, populations: Flow, *, atol: float) -> None:
    for flow in (moments, populations):
        flow.update_velocity()
    air = populations.kind.numpy() == FLUID
    u = populations.velocity.numpy()
    assert np.abs(u[air]).max() > 0.02
    np.testing.assert_allclose(moments.velocity.numpy(), u, atol=atol)
    np.testing.assert_allclose(moments.density.numpy(), populations.density.numpy(), atol=atol)
    np.testing.assert_allclose(moments.populations()[:, air], populations.populations()[:, air], atol=atol)


@pytest.mark.parametrize("room", ROOMS)
def test_moments_equal_their_population_twin(room, device) -> None:
    both = pair(ROOMS[room], device)
    for flow in both:
        push(flow, np.random.default_rng(3))
        flow.step(12)
    compare(*both, atol=1e-6)


def test_moving_obstacle_equals_the_twin(device, rng) -> None:
    z, y, x = np.indices([n + 2 for n in SHAPE])
    both = pair(ROOMS["slip sides, periodic in z"], device)
    for flow in both:
        for centre in (4.0, 5.0, 6.0):  # through the periodic side too
            ball = ((x - centre) ** 2 + (y - 5) ** 2 + (z - 2) ** 2 < 7).astype(np.int32)
            wall = np.zeros((*ball.shape, 3), dtype=np.float32)
            wall[ball == 1, 0] = 0.05
            flow.set_solid(wp.array(ball, dtype=wp.int32, device=device), wp.array(wall, dtype=wp.vec3, device=device))
            flow.step(8)
            flow.update_velocity()
    # where the body lets go both start from equilibrium: of second order in u, or of third
    compare(*both, atol=2e-5)
    np.testing.assert_allclose(both[0].force_on_solid(), both[1].force_on_solid(), atol=1e-4)


def test_inlet_and_open_side_differ_only_in_the_third_order(device) -> None:
    both = pair(Faces(y_high="open"), device, viscosity=0.02)
    for flow in both:
        inlet = np.zeros(flow.kind.shape, dtype=np.int32)
        inlet[3:7, 0, 4:8] = 1
        flow.set_inlets(wp.array(inlet, dtype=wp.int32, device=device))
        blown = flow.imposed.numpy()
        blown[inlet == 1] = (0.0, 0.08, 0.0)
        flow.imposed.assign(blown)
        assert (flow.kind.numpy() == INLET).sum() == 16
        flow.step(60)
    compare(*both, atol=8 * 0.08**3)


def test_moments_of_the_series_are_the_stored_moments(device, rng) -> None:
    """The encoding's invariant: nothing is lost between ten moments and 27 populations."""
    flow = MomentFlow(config(ROOMS["periodic"]), shape_zyx=SHAPE, viscosity=0.001, device=device)
    push(flow, rng)
    flow.step(10)
    stored = flow.moments()[:, 1:-1, 1:-1, 1:-1]
    f = flow.populations()[:, 1:-1, 1:-1, 1:-1] + D3Q27.weights[:, None, None, None]
    density, v, stress = oracle.moments(D3Q27, f, np.zeros((3, *SHAPE)))
    rebuilt = [density - 1.0, *v, *(stress[a, b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))]
    assert np.abs(stored[4:]).max() > 1e-4
    np.testing.assert_allclose(rebuilt, stored, rtol=0.0, atol=1e-8)  # float32 populations


def test_closed_box_keeps_its_mass(device, rng) -> None:
    flow = MomentFlow(config(Faces()), shape_zyx=SHAPE, viscosity=0.01, device=device)
    push(flow, rng)
    flow.step(1000)
    flow.update_velocity()
    density = flow.density.numpy()[1:-1, 1:-1, 1:-1].astype(np.float64)
    assert density.std() > 1e-4
    assert abs(density.mean() - 1.0) < 5e-6


def test_restart_goes_on_with_the_same_bytes(device, rng) -> None:
    kept = {"shape_zyx": SHAPE, "viscosity": 0.001, "device": device}
    flow, again = (MomentFlow(config(Faces(y_high=LID)), **kept) for _ in range(2))
    push(flow, rng)
    flow.step(5)
    again.restore(flow.state())
    for other in (flow, again):
        other.step(6)
    np.testing.assert_array_equal(again.moments(), flow.moments())


@pytest.mark.parametrize(
    "changes", [{"lattice": "D3Q19", "model": "bgk"}, {"model": "regularised"}, {"streaming": "in_place"}]
)
def test_what_moments_cannot_stand_for_is_refused(changes, device) -> None:
    with pytest.raises(ValueError, match="ten moments stand for"):
        MomentFlow(config(Faces(), **changes), shape_zyx=SHAPE, viscosity=0.01, device=device)
