"""Generated C++ of the moment-encoded lattice: ten moments a cell instead of 27 populations (Li et al. 2023).

A cell's moments, in planes as `sim.flow.generated.air` has populations: density - 1, velocity v (x, y, z) at the end
of the step, and the stress about v less density / 3 (xx, yy, zz, xy, xz, yz). All it sends follows from
them. Cells that are no air have moments too: SOLID ones the velocity of their wall, the others what they stand for.
"""

from functools import cache

import warp as wp

from sixway.sim.flow import collision
from sixway.sim.flow.generated import pieces
from sixway.sim.flow.lattice import D3Q27, FLUID

MOMENTS = ("t_shift", *(f"t_v{a}" for a in collision.AXES), *(f"t_p{a}{b}" for a, b in collision.PLANES))
"""The ten moments as `sixway.sim.flow.collision` names them, in their order in memory."""


@cache
def collide_and_stream() -> wp.Kernel:
    """One step of all FLUID cells: rebuild what each neighbour sends hither, relax, store ten moments.

    Half-way bounce-back: hindered by a wall, what arrives along c is what the cell itself sent along -c, and that is
    its series along c with v reversed; a moving wall adds Ladd's term (Krueger et al. 2017, Eq. 5.26).
    """
    snippet = f"""
        {pieces.inner_cell("kind")}
        const long long plane = before.shape[1];
        {pieces.FORCE}
        const int* kinds = kind.data;
        const int* solid = walls.data;
        {" ".join(f"const float* const read{m} = before.data + {m} * plane;" for m in range(len(MOMENTS)))}
        {" ".join(f"float* const write{m} = after.data + {m} * plane;" for m in range(len(MOMENTS)))}
        {pieces.VECTORISE}
        for (int n = cell; n < cell + count; ++n) {{
            {" ".join(f"const float own{m} = read{m}[n];" for m in range(len(MOMENTS)))}
            {" ".join(_arriving(q) for q in range(len(D3Q27.weights)))}
            const float ax = force_x[n], ay = force_y[n], az = force_z[n];
            {" ".join(collision.moments(D3Q27))}
            {" ".join(collision.relaxed())}
            const bool air = kinds[n] == {FLUID};
            {" ".join(f"write{m}[n] = air ? {name} : own{m};" for m, name in enumerate(MOMENTS))}
        }}
    """

    @wp.func_native(snippet)
    def step_row(
        kind: wp.array3d[wp.int32],
        walls: wp.array3d[wp.int32],
        force: wp.array4d[wp.float32],
        before: wp.array2d[wp.float32],
        after: wp.array2d[wp.float32],
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
        walls: wp.array3d[wp.int32],
        force: wp.array4d[wp.float32],
        before: wp.array2d[wp.float32],
        after: wp.array2d[wp.float32],
        tau: float,
        smagorinsky: float,
        count: int,
    ):
        k, j, i = wp.tid()
        step_row(kind, walls, force, before, after, tau, smagorinsky, count, k + first, j, i)

    return step


@cache
def expand() -> wp.Kernel:
    """Populations g = f - w of every cell from its moments: the Hermite series of third order."""
    snippet = f"""
        const long long plane = moments.shape[1];
        {" ".join(f"const float {name} = moments.data[{m} * plane + n];" for m, name in enumerate(MOMENTS))}
        const float rho = 1.0f + t_shift;
        {" ".join(collision.hermite(collision.THIRD_ORDER))}
        {" ".join(f"populations.data[{q} * plane + n] = {_series(q)};" for q in range(len(D3Q27.weights)))}
    """

    @wp.func_native(snippet)
    def expand_cell(moments: wp.array2d[wp.float32], populations: wp.array2d[wp.float32], n: int): ...

    @wp.kernel(module="unique", enable_backward=False)
    def expand(first: int, moments: wp.array2d[wp.float32], populations: wp.array2d[wp.float32]):
        expand_cell(moments, populations, first + wp.tid())  # type: ignore[operator]

    return expand


def _series(q: int) -> str:
    """Population q from the Hermite moments `t_a<powers>`."""
    c = D3Q27.velocities[q].tolist()
    return collision.population(c, _seen_along(c))


def _seen_along(c: list[int]) -> list[collision.Orders]:
    """Orders whose polynomial does not vanish at c: H_1(0) = 0."""
    return [n for n in collision.THIRD_ORDER if all(power != 1 or part for power, part in zip(n, c, strict=True))]


def _arriving(q: int) -> str:
    """`f<q>`: the series of the upwind cell, or, before a wall, of the cell itself with v reversed."""
    c = D3Q27.velocities[q].tolist()
    orders = _seen_along(c)
    upwind = f"n - ({c[0]} + {c[1]} * nx + {c[2]} * nx * ny)"
    lines = [f"float f{q}; {{ const int m = {upwind}; const bool wall = solid[m] != 0;"]
    for m, name in enumerate(MOMENTS):
        sign = "-" if name.startswith("t_v") else ""
        lines.append(f"const float there{m} = read{m}[m], {name} = wall ? {sign}own{m} : there{m};")
    lines.append("const float rho = 1.0f + t_shift;")
    lines += collision.hermite(orders)
    along = " + ".join(f"{part}.0f * there{1 + axis}" for axis, part in enumerate(c) if part) or "0.0f"
    pushed = f"rho * {6.0 * float(D3Q27.weights[q]):.9g}f * ({along})"
    lines.append(f"f{q} = {_series(q)} + (wall ? {pushed} : 0.0f); }}")
    return "\n".join(lines)
