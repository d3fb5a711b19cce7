"""Generated C++ kernels of what is no fluid: bounce-back walls and obstacles, inlets, open, slip and periodic sides.

Layouts as in `sixway.sim.flow.generated.air`. `links` has a bit for each boundary link, c_q along which a cell that is
no fluid has a neighbour that is: what it sends there is all that the air knows of it.
"""

from functools import cache

import warp as wp

from sixway.sim.flow.generated import pieces
from sixway.sim.flow.generated.pieces import Streaming
from sixway.sim.flow.lattice import FLUID, SOLID, LatticeName, lattice_named

OPEN_RELAXATION = 0.01
"""Part of its difference from 1 that the density beyond an OPEN side loses against the cell before it.

1 holds the pressure and throws sound back: 0.9 and 1.1 of a pulse 5 and 10 cells wide; 0.01 throws back 0.10 and 0.15,
and what it does to a jet 2 diameters before it is 3 % of the jet's speed instead of 7 %. With less the mean pressure is
left to drift.
"""


@cache
def find_links(name: LatticeName) -> wp.Kernel:
    """links[n]: bit q where cell n is no air and its neighbour along c_q is air of the box."""
    lattice = lattice_named(name)
    tests = "\n".join(
        f"if (i + {x} > 0 && i + {x} < nx - 1 && j + {y} > 0 && j + {y} < ny - 1 && k + {z} > 0 && k + {z} < nz - 1"
        f" && kind.data[n + {pieces.offset_of((x, y, z))}] == {FLUID}) found |= 1 << {q};"
        for q, (x, y, z) in enumerate(lattice.velocities.tolist())
        if q
    )
    snippet = f"""
        {pieces.size_of("kind")}
        const int n = (k * ny + j) * nx + i;
        int found = 0;
        if (kind.data[n] != {FLUID}) {{ {tests} }}
        links.data[n] = found;
    """

    @wp.func_native(snippet)
    def find(
        kind: wp.array3d[wp.int32],
        links: wp.array3d[wp.int32],
        k: int,
        j: int,
        i: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def find_links(first: int, kind: wp.array3d[wp.int32], links: wp.array3d[wp.int32]):
        k, j, i = wp.tid()
        find(kind, links, k + first, j, i)

    return find_links


@cache
def send(name: LatticeName, streaming: Streaming) -> wp.Kernel:
    """What cells that are no air send to their neighbours that are; `links` says along which c_q.

    SOLID: half-way bounce-back, with Ladd's term where the wall moves (Krueger et al. 2017, Eq. 5.26).
    INLET: the equilibrium at the imposed velocity and the density of the cell that receives it. With density 1,
    a third of that cell's excess would be missing from the speed. A box with inlets needs a way out, or it fills.
    OPEN: the equilibrium at the velocity of the cell before it and at nearly its density, so that sound leaves too; the
    rest of its density draws it towards 1. Where it blows inwards, air of density 1 at rest: with the velocity of
    the last step a back flow would feed on itself.
    IMAGE: what the cell sends that it stands for.
    """
    lattice = lattice_named(name)
    snippet = f"""
        {pieces.KINDS}
        {pieces.size_of("kind")}
        {pieces.out_table(lattice, streaming)}
        {pieces.equilibrium_table(lattice)}
        {pieces.mirror_table(lattice)}
        {pieces.LOWEST_BIT}
        for (int i = column; i < column + count; ++i) {{
            const int n = (k * ny + j) * nx + i;
            const int along = links.data[n];
            if (!along) continue;
            int what = kind.data[n];
            {pieces.image_cell()}
            what = kind.data[at];
            float shift = 0.0f, ux = imposed.data[at][0], uy = imposed.data[at][1], uz = imposed.data[at][2];
            if (what == OPEN) {{
                const int in_i = at_i == 0 ? 1 : at_i == nx - 1 ? nx - 2 : at_i;
                const int in_j = at_j == 0 ? 1 : at_j == ny - 1 ? ny - 2 : at_j;
                const int in_k = at_k == 0 ? 1 : at_k == nz - 1 ? nz - 2 : at_k;
                const int before = (in_k * ny + in_j) * nx + in_i;
                {pieces.moments_of(lattice, "before")}
                ux = momentum_x / density; uy = momentum_y / density; uz = momentum_z / density;
                shift = {1.0 - OPEN_RELAXATION}f * (density - 1.0f);
                const bool inwards =
                    (in_i - at_i) * ux > 0.0f || (in_j - at_j) * uy > 0.0f || (in_k - at_k) * uz > 0.0f;
                if (inwards || kind.data[before] != FLUID) shift = ux = uy = uz = 0.0f;
            }}
            if (flip & 1) ux = -ux;
            if (flip & 2) uy = -uy;
            if (flip & 4) uz = -uz;
            const bool moving = ux != 0.0f || uy != 0.0f || uz != 0.0f;
            for (unsigned left = along; left; left &= left - 1) {{
                const int q = lowest_bit(left), x = n + offset[q];
                if (what == SOLID && !moving) out[q][n] = out[opposite[q]][x];
                else if (what == FLUID) out[q][n] = out[mirrored[flip][q]][at];
                else if (what == SOLID) {{
                    {pieces.moments_of(lattice, "x")}
                    const float along_wall = cx[q] * ux + cy[q] * uy + cz[q] * uz;
                    out[q][n] = out[opposite[q]][x] + 6.0f * weight[q] * density * along_wall;
                }} else if (what == INLET) {{
                    {pieces.moments_of(lattice, "x")}
                    out[q][n] = equilibrium(q, density - 1.0f, ux, uy, uz);
                }} else out[q][n] = equilibrium(q, shift, ux, uy, uz);
            }}
        }}
    """

    @wp.func_native(snippet)
    def send_row(
        kind: wp.array3d[wp.int32],
        links: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        parity: int,
        count: int,
        k: int,
        j: int,
        column: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def send(
        first: int,
        kind: wp.array3d[wp.int32],
        links: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        parity: int,
        count: int,
    ):
        k, j, column = wp.tid()
        send_row(kind, links, imposed, grid, parity, count, k + first, j, column)

    return send


@cache
def exchange(name: LatticeName, streaming: Streaming) -> wp.Kernel:
    """Momentum that the obstacles take in the coming step, one sum a row, so that no two threads add to one place.

    A population g goes in along -c and comes back as g' along c: (-c - u) g - (c - u) g', u the wall's velocity
    (Wen et al. 2014, Eq. 12).
    """
    lattice = lattice_named(name)
    snippet = f"""
        {pieces.size_of("kind")}
        {pieces.out_table(lattice, streaming)}
        {pieces.equilibrium_table(lattice)}
        {pieces.mirror_table(lattice)}
        {pieces.LOWEST_BIT}
        float sum_x = 0.0f, sum_y = 0.0f, sum_z = 0.0f;
        for (int i = 0; i < nx; ++i) {{
            const int n = (k * ny + j) * nx + i;
            const int what = kind.data[n];
            if (!links.data[n]) continue;
            {pieces.image_cell()}
            const bool side = at_i == 0 || at_i == nx - 1 || at_j == 0 || at_j == ny - 1 || at_k == 0 || at_k == nz - 1;
            if (side) continue;
            if (kind.data[at] != {SOLID}) continue;
            const float sign_x = flip & 1 ? -1.0f : 1.0f, sign_y = flip & 2 ? -1.0f : 1.0f;
            const float sign_z = flip & 4 ? -1.0f : 1.0f;
            const float ux = sign_x * imposed.data[at][0], uy = sign_y * imposed.data[at][1];
            const float uz = sign_z * imposed.data[at][2];
            for (unsigned left = links.data[n]; left; left &= left - 1) {{
                const int q = lowest_bit(left), x = n + offset[q];
                {pieces.moments_of(lattice, "x")}
                const float push = 6.0f * weight[q] * density * (cx[q] * ux + cy[q] * uy + cz[q] * uz);
                const float both = 2.0f * out[opposite[q]][x] + push;
                sum_x += sign_x * (push * ux - both * cx[q]);
                sum_y += sign_y * (push * uy - both * cy[q]);
                sum_z += sign_z * (push * uz - both * cz[q]);
            }}
        }}
        rows.data[k * ny + j] = wp::vec_t<3, wp::float32>(sum_x, sum_y, sum_z);
    """

    @wp.func_native(snippet)
    def exchange_row(
        kind: wp.array3d[wp.int32],
        links: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        rows: wp.array2d[wp.vec3],
        parity: int,
        k: int,
        j: int,
    ): ...

    @wp.kernel(module="unique", enable_backward=False)
    def exchange(
        first: int,
        kind: wp.array3d[wp.int32],
        links: wp.array3d[wp.int32],
        imposed: wp.array3d[wp.vec3],
        grid: wp.array2d[wp.float32],
        parity: int,
        rows: wp.array2d[wp.vec3],
    ):
        k, j = wp.tid()
        exchange_row(kind, links, imposed, grid, rows, parity, k + first, j)

    return exchange
