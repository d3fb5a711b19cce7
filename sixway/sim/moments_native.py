"""Generated C++ of the moment-encoded lattice: ten moments a cell instead of 27 populations (Li et al. 2023).

A cell's moments, in planes of `stride` floats as `flow.generated.air` has them: density - 1, velocity v (x, y, z)
at the end of the step, and the stress about v less density / 3 (xx, yy, zz, xy, xz, yz). All it sends follows from
them. Cells that are no air have moments too: SOLID ones the velocity of their wall, the others what they stand for.
"""

from functools import cache

import warp as wp

from sixway.sim.flow import collision
from sixway.sim.flow.lattice import D3Q27, FLUID

MOMENTS = ("t_shift", *(f"t_v{a}" for a in collision.AXES), *(f"t_p{a}{b}" for a, b in collision.PLANES))
"""The ten moments as `sixway.sim.flow.collision` names them, in their order in memory."""


@cache
def collide_and_stream() -> wp.Kernel:
    """One step of all FLUID cells: rebuild what each neighbour sends hither, relax, store ten moments.

    Half-way bounce-back: hindered by a wall, what arrives along c is what the cell itself sent along -c, and that is
    its series along c with v turned round; a moving wall adds Ladd's term (Krueger et al. 2017, Eq. 5.26).
    """
    snippet = f"""
        const long long plane = stride;
        const float* force_x = force.data;
        const float* force_y = force_x + cells;
        const float* force_z = force_y + cells;
        const int* kinds = kind.data;
        const int* solid = walls.data;
        {" ".join(f"const float* const read{m} = before.data + {m} * plane;" for m in range(len(MOMENTS)))}
        {" ".join(f"float* const write{m} = after.data + {m} * plane;" for m in range(len(MOMENTS)))}
        #ifdef __clang__
        #pragma clang loop vectorize(assume_safety)
        #endif
        for (int n = row; n < row + count; ++n) {{
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
        before: wp.array[wp.float32],
        after: wp.array[wp.float32],
        nx: int,
        ny: int,
        cells: int,
        stride: int,
        tau: float,
        cs: float,
        row: int,
        count: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def step(
        first: int,
        kind: wp.array3d[wp.int32],
        walls: wp.array3d[wp.int32],
        force: wp.array4d[wp.float32],
        before: wp.array[wp.float32],
        after: wp.array[wp.float32],
        stride: int,
        tau: float,
        cs: float,
        count: int,
    ):
        k, j, i = wp.tid()
        nx = kind.shape[2]
        ny = kind.shape[1]
        cells = kind.shape[0] * ny * nx
        row = ((k + first + 1) * ny + j + 1) * nx + i + 1
        step_row(kind, walls, force, before, after, nx, ny, cells, stride, tau, cs, row, count)

    return step


def _arriving(q: int) -> str:
    """`f<q>`: the series of the upwind cell, or, before a wall, of the cell itself with v turned round."""
    c = D3Q27.velocities[q].tolist()
    orders = [n for n in collision.THIRD_ORDER if all(power != 1 or part for power, part in zip(n, c, strict=True))]
    upwind = f"n - ({c[0]} + {c[1]} * nx + {c[2]} * nx * ny)"
    lines = [f"float f{q}; {{ const int m = {upwind}; const bool wall = solid[m] != 0;"]
    for m, name in enumerate(MOMENTS):
        turned = "-" if name.startswith("t_v") else ""
        lines.append(f"const float there{m} = read{m}[m], {name} = wall ? {turned}own{m} : there{m};")
    lines.append("const float rho = 1.0f + t_shift;")
    lines += collision.hermite(orders)
    along = " + ".join(f"{part}.0f * there{1 + axis}" for axis, part in enumerate(c) if part) or "0.0f"
    pushed = f"rho * {6.0 * float(D3Q27.weights[q]):.9g}f * ({along})"
    lines.append(f"f{q} = {collision.population(c, orders)} + (wall ? {pushed} : 0.0f); }}")
    return "\n".join(lines)
