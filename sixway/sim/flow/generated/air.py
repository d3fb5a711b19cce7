"""Generated C++ kernels over rows of fluid: collision and streaming, density and velocity, start, sources of gas.

Warp's own loops over arrays are not vectorised on a CPU; a native snippet over a row of cells is. On CUDA a row is
one cell. Populations are shifted by their weights, g = f - w, and lie in planes, one a population
(`pieces` says where). Cells that are no fluid do not collide; before each step `edges.send` writes what they
send. The step itself then knows neither walls nor sides, and no kernel writes where another thread reads.

`first`: the first slice of a thread's band (`sixway.bands`). `count`: cells a thread takes.
"""

from functools import cache

import warp as wp

from sixway.sim.flow import collision
from sixway.sim.flow.generated import pieces
from sixway.sim.flow.generated.pieces import Streaming
from sixway.sim.flow.lattice import FLUID, CollisionModel, LatticeName, lattice_named


@cache
def collide_and_stream(name: LatticeName, model: CollisionModel, streaming: Streaming) -> wp.Kernel:
    """One step of all cells: pull, collide, send. Cells that are no FLUID send 0, which keeps NaN out of unread places.

    In place, `before` and `after` are one array.
    """
    lattice = lattice_named(name)
    pull = "\n".join(f"float f{q} = read{q}[n];" for q in range(len(lattice.weights)))
    send = "\n".join(f"write{q}[n] = air ? f{q} : 0.0f;" for q in range(len(lattice.weights)))
    snippet = f"""
        {pieces.inner_cell("kind")}
        {pieces.read_pointers(lattice, streaming)}
        {pieces.write_pointers(lattice, streaming)}
        {pieces.FORCE}
        const int* kinds = kind.data;
        {pieces.VECTORISE}
        for (int n = cell; n < cell + count; ++n) {{
            {pull}
            const float ax = force_x[n], ay = force_y[n], az = force_z[n];
            {collision.text(lattice, model)}
            const bool air = kinds[n] == {FLUID};
            {send}
        }}
    """

    @wp.func_native(snippet)
    def step_row(
        kind: wp.array3d[wp.int32],
        force: wp.array4d[wp.float32],
        grid: wp.array2d[wp.float32],
        after: wp.array2d[wp.float32],
        parity: int,
        tau: float,
        smagorinsky: float,
        count: int,
        k: int,
        j: int,
        i: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def step(
        first: int,
        kind: wp.array3d[wp.int32],
        force: wp.array4d[wp.float32],
        before: wp.array2d[wp.float32],
        after: wp.array2d[wp.float32],
        parity: int,
        tau: float,
        smagorinsky: float,
        count: int,
    ):
        k, j, i = wp.tid()
        step_row(kind, force, before, after, parity, tau, smagorinsky, count, k + first, j, i)

    return step


@cache
def measure(name: LatticeName, streaming: Streaming) -> wp.Kernel:
    """Density and velocity of the box's cells from what they send; SOLID and INLET cells have what is imposed.

    Collision has added the force to the momentum, of which the velocity in the middle of the step has half
    (Guo, Zheng & Shi 2002, Eq. 3).
    """
    lattice = lattice_named(name)
    snippet = f"""
        {pieces.inner_cell("kind")}
        {pieces.read_pointers(lattice, streaming)}
        {pieces.out_pointers(lattice)}
        {pieces.FORCE}
        const float* fixed = reinterpret_cast<const float*>(imposed.data);
        float* wind = reinterpret_cast<float*>(velocity.data);
        const int* kinds = kind.data;
        float* mass = densities.data;
        {pieces.VECTORISE}
        for (int n = cell; n < cell + count; ++n) {{
            {pieces.moments_of(lattice, "n", array=False)}
            const bool air = kinds[n] == {FLUID};
            const float volume = 1.0f / density;
            mass[n] = air ? density : 1.0f;
            const float fixed_x = fixed[3 * n], fixed_y = fixed[3 * n + 1], fixed_z = fixed[3 * n + 2];
            wind[3 * n] = air ? momentum_x * volume - 0.5f * force_x[n] : fixed_x;
            wind[3 * n + 1] = air ? momentum_y * volume - 0.5f * force_y[n] : fixed_y;
            wind[3 * n + 2] = air ? momentum_z * volume - 0.5f * force_z[n] : fixed_z;
        }}
    """

    @wp.func_native(snippet)
    def measure_row(
        kind: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        force: wp.array4d[wp.float32],
        grid: wp.array2d[wp.float32],
        densities: wp.array3d[wp.float32],
        velocity: wp.array3d[wp.vec3],
        parity: int,
        count: int,
        k: int,
        j: int,
        i: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def measure(
        first: int,
        kind: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        force: wp.array4d[wp.float32],
        grid: wp.array2d[wp.float32],
        parity: int,
        count: int,
        density: wp.array3d[wp.float32],
        velocity: wp.array3d[wp.vec3],
    ):
        k, j, i = wp.tid()
        measure_row(kind, imposed, force, grid, density, velocity, parity, count, k + first, j, i)

    return measure


@cache
def fill(name: LatticeName, streaming: Streaming) -> wp.Kernel:
    """Make cells send the equilibrium of a density and a velocity, where `chosen`."""
    lattice = lattice_named(name)
    snippet = f"""
        {pieces.inner_cell("chosen")}
        const int n = cell;
        if (!chosen.data[n]) return;
        {pieces.out_table(lattice, streaming)}
        {pieces.equilibrium_table(lattice)}
        const float shift = density.data[n] - 1.0f;
        const float ux = velocity.data[n][0], uy = velocity.data[n][1], uz = velocity.data[n][2];
        for (int q = 0; q < {len(lattice.weights)}; ++q) out[q][n] = equilibrium(q, shift, ux, uy, uz);
    """

    @wp.func_native(snippet)
    def fill_cell(
        chosen: wp.array3d[wp.int32],
        density: wp.array3d[wp.float32],
        velocity: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        parity: int,
        k: int,
        j: int,
        i: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def fill(
        first: int,
        chosen: wp.array3d[wp.int32],
        density: wp.array3d[wp.float32],
        velocity: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        parity: int,
    ):
        k, j, i = wp.tid()
        fill_cell(chosen, density, velocity, grid, parity, k + first, j, i)

    return fill


@cache
def grow(name: LatticeName, streaming: Streaming) -> wp.Kernel:
    """Add gas of the air's own velocity to what FLUID cells send: g_q += w_q s (1 + 3 c_q . u), s = `growth` [1/step].

    Gas at rest would brake the air by the same rate.
    """
    lattice = lattice_named(name)
    snippet = f"""
        {pieces.inner_cell("kind")}
        const int n = cell;
        const float s = growth.data[n];
        if (kind.data[n] != {FLUID} || s == 0.0f) return;
        {pieces.out_table(lattice, streaming)}
        {pieces.equilibrium_table(lattice)}
        {pieces.moments_of(lattice, "n")}
        const float slope = 3.0f * s / density;
        for (int q = 0; q < {len(lattice.weights)}; ++q) {{
            const float along = cx[q] * momentum_x + cy[q] * momentum_y + cz[q] * momentum_z;
            out[q][n] += weight[q] * (s + slope * along);
        }}
    """

    @wp.func_native(snippet)
    def grow_cell(
        kind: wp.array3d[wp.int32],
        growth: wp.array3d[wp.float32],
        grid: wp.array2d[wp.float32],
        parity: int,
        k: int,
        j: int,
        i: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def grow(
        first: int,
        kind: wp.array3d[wp.int32],
        growth: wp.array3d[wp.float32],
        grid: wp.array2d[wp.float32],
        parity: int,
    ):
        k, j, i = wp.tid()
        grow_cell(kind, growth, grid, parity, k + first, j, i)

    return grow
