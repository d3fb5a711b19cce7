"""The air: a step equals its oracle at every kind of boundary; flows with known answers; threads, places, restarts."""

import re

import numpy as np
import pytest
import warp as wp
from pydantic import ValidationError

from sixway.sim.flow import oracle
from sixway.sim.flow.faces import Faces, MovingWall
from sixway.sim.flow.flow import INSIDE, Flow, FlowConfig
from sixway.sim.flow.generated.pieces import Streaming
from sixway.sim.flow.lattice import FLUID, LatticeName, lattice_named

LATTICES: tuple[LatticeName, ...] = ("D3Q19", "D3Q27")
STREAMINGS: tuple[Streaming, ...] = ("two_grids", "in_place")
LID = MovingWall(velocity=(0.05, 0.0, 0.02))
PERIODIC = {f"{axis}_{end}": "periodic" for axis in "xyz" for end in ("low", "high")}
BOXES = {
    "walls": Faces(),
    "lid": Faces(y_high=LID),
    "periodic": Faces(**PERIODIC),
    "slip": Faces(x_low="slip", x_high="slip", y_low="slip", z_low="slip"),
    "open": Faces(x_high="open", y_high="open", z_low="slip"),
    "all": Faces(x_low="periodic", x_high="periodic", y_low=LID, y_high="open", z_low="slip", z_high="slip"),
}


def stirred(
    device: str,
    rng: np.random.Generator,
    *,
    lattice: LatticeName = "D3Q19",
    streaming: Streaming = "two_grids",
    faces: Faces | None = None,
    threads: int = 1,
    shape: tuple[int, int, int] = (6, 7, 9),
) -> Flow:
    """A flow in a box with two moving obstacles, one at a side, inlets within and in the shell, and a force."""
    config = FlowConfig(lattice=lattice, streaming=streaming, faces=faces or Faces(), smagorinsky=0.1)
    flow = Flow(config, shape_zyx=shape, viscosity=0.02, device=device, threads=threads)
    inlet = np.zeros(flow.kind.shape, dtype=np.int32)
    inlet[3:5, 1, 2:4] = 1
    if flow.config.faces.x_low != "periodic":
        inlet[0:4, 2:4, 0] = 1  # also in a corner of the box
    flow.set_inlets(wp.array(inlet, dtype=wp.int32, device=device))
    imposed = flow.imposed.numpy().copy()
    imposed[inlet != 0] = rng.uniform(-0.05, 0.05, 3)
    flow.imposed.assign(imposed)
    solid = np.zeros_like(inlet)
    solid[3:5, 3:6, 4:6] = 1
    solid[1:3, 6:8, 8:] = 1
    wall_velocity = rng.uniform(-0.05, 0.05, (*solid.shape, 3))
    put_solid(flow, solid, wall_velocity)
    flow.force.assign(rng.uniform(-1e-3, 1e-3, flow.force.shape))
    flow.set_flow(velocity=rng.uniform(-0.1, 0.1, (*shape, 3)), density=rng.uniform(0.97, 1.03, shape))
    return flow


def put_solid(flow: Flow, solid: np.ndarray, wall_velocity: np.ndarray) -> None:
    device = flow.kind.device
    flow.set_solid(
        wp.array(solid, dtype=wp.int32, device=device), wp.array(wall_velocity, dtype=wp.vec3, device=device)
    )


def periodic_along(axes: str, **others: object) -> Faces:
    return Faces(**{name: face for name, face in PERIODIC.items() if name[0] in axes}, **others)


def air_of(flow: Flow) -> np.ndarray:
    air = np.zeros(flow.kind.shape, dtype=bool)
    air[INSIDE] = flow.kind.numpy()[INSIDE] == FLUID
    return air


def velocity_of(flow: Flow) -> np.ndarray:
    flow.update_velocity()
    return flow.velocity.numpy()[INSIDE]


@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("streaming", STREAMINGS)
@pytest.mark.parametrize("lattice", LATTICES)
def test_steps_equal_the_oracle(
    device: str, rng: np.random.Generator, lattice: LatticeName, streaming: Streaming, box: str
) -> None:
    flow = stirred(device, rng, lattice=lattice, streaming=streaming, faces=BOXES[box])
    velocities, air = lattice_named(lattice), air_of(flow)
    kind, imposed, force = (array.numpy().astype(float) for array in (flow.kind, flow.imposed, flow.force))
    kind = kind.astype(int)
    g = flow.populations().astype(float)
    for _ in range(3):
        np.testing.assert_allclose(
            flow.force_on_solid(), oracle.force_on_solid(velocities, kind, imposed, g), atol=1e-6
        )
        flow.step()
        g = oracle.step(velocities, flow.config.model, kind, imposed, force, g, tau=0.56, smagorinsky=0.1)
        np.testing.assert_allclose(flow.populations()[:, air], g[:, air], atol=1e-7)
    flow.update_velocity()
    density, velocity = oracle.measure(velocities, kind, imposed, force, g)
    np.testing.assert_allclose(flow.density.numpy()[INSIDE], density[INSIDE], atol=2e-6)
    np.testing.assert_allclose(flow.velocity.numpy()[INSIDE], velocity[INSIDE], atol=2e-6)


@pytest.mark.parametrize("streaming", STREAMINGS)
@pytest.mark.parametrize("lattice", LATTICES)
def test_growth_equals_the_oracle(
    device: str, rng: np.random.Generator, lattice: LatticeName, streaming: Streaming
) -> None:
    flow = stirred(device, rng, lattice=lattice, streaming=streaming)
    velocities, air = lattice_named(lattice), air_of(flow)
    growth = rng.uniform(0.0, 0.05, flow.kind.shape) * rng.integers(0, 2, flow.kind.shape)
    flow.growth = wp.array(growth, dtype=wp.float32, device=device)
    kind, imposed, force = (array.numpy().astype(float) for array in (flow.kind, flow.imposed, flow.force))
    kind = kind.astype(int)
    g = flow.populations().astype(float)
    for _ in range(2):
        flow.step()
        g = oracle.step(velocities, flow.config.model, kind, imposed, force, g, tau=0.56, smagorinsky=0.1)
        g = oracle.grow(velocities, kind, growth, g)
        np.testing.assert_allclose(flow.populations()[:, air], g[:, air], atol=2e-7)


def test_growing_gas_blows_out_of_an_open_box_as_much_as_it_grows(device: str) -> None:
    """Long after the sound has left, the flux through a cube around the source is its growth."""
    sides = {f"{axis}_{end}": "open" for axis in "xyz" for end in ("low", "high")}
    flow = Flow(FlowConfig(faces=Faces(**sides)), shape_zyx=(20, 20, 20), viscosity=0.05, device=device)
    growth = np.zeros((22, 22, 22), np.float32)
    growth[9:13, 9:13, 9:13] = 2e-3
    flow.growth = wp.array(growth, dtype=wp.float32, device=device)
    flow.step(600)
    u = velocity_of(flow)
    out, cube = 0.0, slice(4, 16)
    for axis in range(3):
        along = np.moveaxis(u[..., axis], 2 - axis, 0)[:, cube, cube].sum(axis=(1, 2))
        out += 0.5 * (along[15] + along[16] - along[3] - along[4])  # sides of the cube lie between cells
    assert out == pytest.approx(growth.sum(), rel=0.05)


@pytest.mark.parametrize("lattice", LATTICES)
def test_streaming_in_place_is_streaming_between_two_grids(device: str, lattice: LatticeName) -> None:
    flows = [
        stirred(device, np.random.default_rng(5), lattice=lattice, streaming=streaming, faces=BOXES["all"])
        for streaming in STREAMINGS
    ]
    for flow in flows:
        flow.step(25)
    air = air_of(flows[0])
    np.testing.assert_allclose(flows[0].populations()[:, air], flows[1].populations()[:, air], atol=1e-7)


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_threads_change_no_byte(device: str, streaming: Streaming) -> None:
    states = []
    for threads in (1, 2):
        flow = stirred(device, np.random.default_rng(6), streaming=streaming, faces=BOXES["all"], threads=threads)
        flow.step(40)
        flow.update_velocity()
        states.append(flow.state())
    for name, array in states[0].items():
        assert array.tobytes() == states[1][name].tobytes(), name


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_a_restored_flow_goes_on_with_the_same_bytes(device: str, streaming: Streaming) -> None:
    flow = stirred(device, np.random.default_rng(7), streaming=streaming, faces=BOXES["all"])
    flow.step(5)
    kept = flow.state()
    flow.step(8)
    other = stirred(device, np.random.default_rng(8), streaming=streaming, faces=BOXES["all"])
    other.step(4)  # so that the other grid is the current one
    other.restore(kept)
    other.step(8)
    for name, array in flow.state().items():
        assert array.tobytes() == other.state()[name].tobytes(), name


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_a_closed_box_keeps_its_mass(device: str, rng: np.random.Generator, streaming: Streaming) -> None:
    flow = Flow(FlowConfig(streaming=streaming), shape_zyx=(16, 16, 16), viscosity=0.002, device=device)
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    solid[6:10, 6:10, 6:10] = 1
    put_solid(flow, solid, np.zeros((*solid.shape, 3)))
    flow.set_flow(velocity=rng.uniform(-0.1, 0.1, (16, 16, 16, 3)), density=rng.uniform(0.97, 1.03, (16, 16, 16)))
    air = air_of(flow)
    before = (1.0 + flow.populations().astype(float).sum(axis=0))[air].sum()
    flow.step(1000)
    after = (1.0 + flow.populations().astype(float).sum(axis=0))[air].sum()
    assert abs(after / before - 1.0) < 1e-5


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_poiseuille(device: str, streaming: Streaming) -> None:
    """Between resting walls a force drives a parabola; D3Q19, tau = 0.8."""
    n, viscosity, peak = 16, 0.1, 0.02
    config = FlowConfig(streaming=streaming, smagorinsky=0.0, faces=periodic_along("xz"))
    flow = Flow(config, shape_zyx=(4, n, 4), viscosity=viscosity, device=device)
    flow.force[0].fill_(8.0 * viscosity * peak / n**2)
    flow.step(6000)
    y = (np.arange(n) + 0.5) / n
    assert np.abs(velocity_of(flow)[2, :, 2, 0] - 4.0 * peak * y * (1.0 - y)).max() < 0.01 * peak


def test_half_a_channel_with_a_slip_side_is_half_a_parabola(device: str) -> None:
    n, viscosity, peak = 8, 0.1, 0.02
    config = FlowConfig(smagorinsky=0.0, faces=periodic_along("xz", y_high="slip"))
    flow = Flow(config, shape_zyx=(4, n, 4), viscosity=viscosity, device=device)
    flow.force[0].fill_(8.0 * viscosity * peak / (2 * n) ** 2)
    flow.step(6000)
    y = (np.arange(n) + 0.5) / (2 * n)
    assert np.abs(velocity_of(flow)[2, :, 2, 0] - 4.0 * peak * y * (1.0 - y)).max() < 0.01 * peak


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_couette_between_a_resting_side_and_a_moving_one(device: str, streaming: Streaming) -> None:
    n, speed = 10, 0.05
    faces = periodic_along("xz", y_high=MovingWall(velocity=(speed, 0.0, 0.0)))
    flow = Flow(FlowConfig(streaming=streaming, faces=faces), shape_zyx=(4, n, 4), viscosity=0.1, device=device)
    flow.step(3000)
    y = (np.arange(n) + 0.5) / n
    np.testing.assert_allclose(velocity_of(flow)[2, :, 2, 0], speed * y, atol=0.005 * speed)


def test_a_sliding_obstacle_drags_the_air_and_feels_the_viscous_stress(device: str) -> None:
    """A slab moves along itself between two resting walls: a force of 2 rho nu U / gap on each unit of area."""
    gap, speed, viscosity = 6, 0.05, 0.1
    config = FlowConfig(smagorinsky=0.0, faces=periodic_along("xz"))
    flow = Flow(config, shape_zyx=(4, 2 * gap + 2, 4), viscosity=viscosity, device=device)
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    solid[1:-1, gap + 1 : gap + 3, 1:-1] = 1
    put_solid(flow, solid, np.where(solid[..., None], (speed, 0.0, 0.0), 0.0))
    flow.step(3000)
    expected = (-2.0 * viscosity * speed / gap * 16, 0.0, 0.0)
    np.testing.assert_allclose(flow.force_on_solid(), expected, atol=0.01 * abs(expected[0]))


def test_momentum_lost_by_the_air_is_the_force_on_the_obstacle(device: str, rng: np.random.Generator) -> None:
    flow = Flow(FlowConfig(faces=Faces(**PERIODIC)), shape_zyx=(10, 10, 10), viscosity=0.02, device=device)
    solid = np.zeros(flow.kind.shape, dtype=np.int32)
    solid[4:7, 4:8, 5:8] = 1
    put_solid(flow, solid, np.zeros((*solid.shape, 3)))
    flow.set_flow(velocity=(0.05, 0.02, -0.01))
    flow.step(3)
    air, velocities = air_of(flow), flow_velocities(flow)
    before = np.einsum("qa,qn->a", velocities, flow.populations()[:, air].astype(float))
    force = flow.force_on_solid()
    flow.step()
    after = np.einsum("qa,qn->a", velocities, flow.populations()[:, air].astype(float))
    assert np.abs(force).max() > 0.01
    np.testing.assert_allclose(before - after, force, atol=1e-4)


def flow_velocities(flow: Flow) -> np.ndarray:
    return lattice_named(flow.config.lattice).velocities.astype(float)


def test_open_sides_let_sound_out(device: str) -> None:
    """What comes back of a pressure pulse, told by a box whose sides are too far to answer."""

    def pulse(cells: int, shift: int) -> np.ndarray:
        faces = periodic_along("yz", x_low="open", x_high="open")
        flow = Flow(FlowConfig(smagorinsky=0.0, faces=faces), shape_zyx=(2, 2, cells), viscosity=0.005, device=device)
        x = np.arange(cells) - shift - 39.5
        flow.set_flow(velocity=(0.0, 0.0, 0.0), density=1.0 + 0.01 * np.exp(-(x**2) / 50.0))
        flow.step(120)
        flow.update_velocity()
        return flow.density.numpy()[1, 1, 1:-1][shift : shift + 80]

    reflected = np.abs(pulse(80, 0) - pulse(240, 80)).max() / 0.005
    assert reflected < 0.2


def test_a_uniform_stream_passes_an_inlet_slip_sides_and_an_open_side_unchanged(device: str) -> None:
    """Where sides meet, a rounding error once chose between outflow and back flow, and the stream halved."""
    sides = {name: "slip" for name in PERIODIC if name[0] in "yz"}
    flow = Flow(FlowConfig(faces=Faces(x_high="open", **sides)), shape_zyx=(4, 5, 16), viscosity=0.005, device=device)
    inlet = np.zeros(flow.kind.shape, dtype=np.int32)
    inlet[:, :, 0] = 1
    flow.set_inlets(wp.array(inlet, dtype=wp.int32, device=device))
    flow.imposed.assign(np.where(inlet[..., None], (0.05, 0.0, 0.0), 0.0))
    flow.set_flow(velocity=(0.05, 0.0, 0.0))
    flow.step(500)
    np.testing.assert_allclose(velocity_of(flow), np.broadcast_to((0.05, 0.0, 0.0), (4, 5, 16, 3)), atol=1e-5)


@pytest.mark.parametrize("streaming", STREAMINGS)
def test_a_moving_obstacle_pushes_the_air_and_leaves_no_hole(device: str, streaming: Streaming) -> None:
    """A block crosses cells one after the other; what it lets go of is air that moves with it."""
    config = FlowConfig(streaming=streaming, faces=Faces(**PERIODIC))
    flow = Flow(config, shape_zyx=(12, 12, 24), viscosity=0.02, device=device)
    speed = 0.1
    for frame in range(12):
        solid = np.zeros(flow.kind.shape, dtype=np.int32)
        solid[5:9, 5:9, 4 + frame : 8 + frame] = 1
        put_solid(flow, solid, np.where(solid[..., None], (speed, 0.0, 0.0), 0.0))
        flow.step(10)
        flow.update_velocity()
    assert flow.kind.numpy()[6, 6, 6] == FLUID
    velocity, density = flow.velocity.numpy()[INSIDE], flow.density.numpy()[INSIDE]
    assert np.isfinite(velocity).all() and np.abs(density - 1.0).max() < 0.05
    assert 0.02 < velocity[5:7, 5:7, 12, 0].min() and velocity[5:7, 5:7, 12, 0].max() < 1.5 * speed
    np.testing.assert_allclose(velocity[5, 5, 16], (speed, 0.0, 0.0), atol=1e-6)


def test_the_shell_has_the_velocity_of_what_lies_beyond(device: str, rng: np.random.Generator) -> None:
    faces = Faces(
        x_low="periodic", x_high="periodic", y_low="slip", y_high="open", z_low=MovingWall(velocity=(0.05, 0.0, 0.0))
    )
    flow = Flow(FlowConfig(faces=faces), shape_zyx=(4, 5, 6), viscosity=0.1, device=device)
    flow.set_flow(velocity=rng.uniform(-0.05, 0.05, (4, 5, 6, 3)))
    flow.step(3)
    flow.update_velocity()
    u = flow.velocity.numpy()
    np.testing.assert_array_equal(u[2, 2, 0], u[2, 2, -2])
    np.testing.assert_array_equal(u[2, 0, 2], u[2, 1, 2] * (1, -1, 1))
    np.testing.assert_array_equal(u[2, -1, 2], u[2, -2, 2])
    np.testing.assert_array_equal(u[0, 2, 2], np.float32((0.05, 0.0, 0.0)))
    np.testing.assert_array_equal(u[-1, 2, 2], (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("faces", "told"),
    [
        ({"x_low": "periodic"}, "make both sides of x periodic, or neither"),
        ({"y_low": MovingWall(velocity=(0.0, 0.1, 0.0))}, "y_low moves by 0.1 along its normal"),
        ({"z_high": MovingWall(velocity=(0.4, 0.0, 0.0))}, "z_high moves at 0.4 cells/step"),
        ({"z_high": "leaky"}, "z_high"),
    ],
)
def test_sides_that_cannot_be_honoured_are_refused(faces: dict, told: str) -> None:
    with pytest.raises(ValidationError, match=re.escape(told)):
        Faces(**faces)


def test_an_inlet_in_a_periodic_side_is_refused(device: str) -> None:
    flow = Flow(FlowConfig(faces=periodic_along("x")), shape_zyx=(4, 4, 4), viscosity=0.1, device=device)
    inlet = np.zeros(flow.kind.shape, dtype=np.int32)
    inlet[2, 2, -1] = 1
    with pytest.raises(ValueError, match="x_high is periodic and has an inlet"):
        flow.set_inlets(wp.array(inlet, dtype=wp.int32, device=device))


def test_flows_that_cannot_be_are_refused(device: str) -> None:
    with pytest.raises(ValidationError, match="needs D3Q27"):
        FlowConfig(lattice="D3Q19", model="third_order")
    with pytest.raises(ValueError, match="viscosity=-0.1"):
        Flow(FlowConfig(), shape_zyx=(4, 4, 4), viscosity=-0.1, device=device)
    with pytest.raises(ValueError, match="at least one cell"):
        Flow(FlowConfig(), shape_zyx=(4, 0, 4), viscosity=0.1, device=device)
    flow = Flow(FlowConfig(), shape_zyx=(4, 4, 4), viscosity=0.1, device=device)
    other = Flow(FlowConfig(), shape_zyx=(4, 4, 5), viscosity=0.1, device=device)
    with pytest.raises(ValueError, match="restore with the config and the shape"):
        flow.restore(other.state())
    with pytest.raises(ValueError, match="solid"):
        flow.set_solid(wp.zeros((4, 4, 4), dtype=wp.int32, device=device), flow.imposed)
