"""Pieces of C++ that the kernels of `air` and `edges` are put together from: streaming, moments, equilibrium, mirrors.

Everything is said in terms of `out[q][n]`, the place of what cell n sends along c_q, which the coming step of cell
n + c_q reads. Where that place is, is the streaming's affair (Krueger et al. 2017, Sec. 13.3; Lehmann 2022):

two_grids: pull from one grid, write the other.
in_place: esoteric pull. Of a pair c, -c a cell reads one at home and one at its neighbour along c, and writes what it
sends back into these two places, crosswise. Half the memory, and no place is shared by two cells.

Arrays are [z, y, x] with a shell of one ghost cell; a cell's number is n = (k ny + j) nx + i. The pieces expect the
names `grid`, `after` [population, place], `parity` (of the steps so far) and a cell's `i`, `j`, `k` to be arguments of
the snippet, and `nx`, `ny`, `nz` to be known by `size_of`.
"""

from typing import Literal

from sixway.sim.flow.lattice import FLUID, IMAGE, INLET, OPEN, SOLID, Lattice

Streaming = Literal["two_grids", "in_place"]

KINDS = f"const int FLUID = {FLUID}, SOLID = {SOLID}, OPEN = {OPEN}, INLET = {INLET}, IMAGE = {IMAGE};"
VECTORISE = """
    #ifdef __clang__
    #pragma clang loop vectorize(assume_safety)
    #endif"""
FORCE = """
        const float* force_x = force.data;
        const float* force_y = force_x + nx * ny * nz;
        const float* force_z = force_y + nx * ny * nz;"""
LOWEST_BIT = """
    #ifdef __CUDA_ARCH__
    auto lowest_bit = [](unsigned bits) { return __ffs(bits) - 1; };
    #else
    auto lowest_bit = [](unsigned bits) { return __builtin_ctz(bits); };
    #endif
"""


def size_of(array: str) -> str:
    """`nx`, `ny`, `nz`: of an array [z, y, x], ghost cells included."""
    return f"const int nz = {array}.shape[0], ny = {array}.shape[1], nx = {array}.shape[2];"


def inner_cell(array: str) -> str:
    """`cell`: number of the cell (i, j, k) of the box, which counts without the ghost cells; `size_of` besides."""
    return f"{size_of(array)} const int cell = ((k + 1) * ny + j + 1) * nx + i + 1;"


def offset_of(velocity: tuple[int, int, int]) -> str:
    """Distance in numbers of cells between a cell and its neighbour along a velocity."""
    x, y, z = velocity
    return f"({x} + {y} * nx + {z} * nx * ny)"


def read_pointers(lattice: Lattice, streaming: Streaming) -> str:
    """`read{q}[n]`: where the coming step reads population q of cell n."""
    c = [tuple(v) for v in lattice.velocities.tolist()]
    lines = ["const long long plane = grid.shape[1];", "float* const read0 = grid.data;"]
    for q in range(1, len(c)):
        match streaming:
            case "two_grids":
                lines.append(f"float* const read{q} = grid.data + {q} * plane - {offset_of(c[q])};")
            case "in_place":
                pair = (q, q + 1) if q % 2 else (q - 1, q)
                place = f"(parity ? {pair[0]} : {pair[1]})" if q % 2 else f"(parity ? {pair[1]} : {pair[0]})"
                home = "" if q % 2 else f" + {offset_of(c[q - 1])}"
                lines.append(f"float* const read{q} = grid.data + {place} * plane{home};")
    return "\n".join(lines)


def write_pointers(lattice: Lattice, streaming: Streaming) -> str:
    """`write{q}[n]`: where this step writes what cell n sends along c_q."""
    q_count = len(lattice.weights)
    match streaming:
        case "two_grids":
            return "\n".join(f"float* const write{q} = after.data + {q} * plane;" for q in range(q_count))
        case "in_place":
            return "\n".join(f"float* const write{q} = read{lattice.opposite[q]};" for q in range(q_count))


def out_pointers(lattice: Lattice) -> str:
    """`out{q}[n]`: where the coming step finds what cell n sent along c_q."""
    return "\n".join(
        f"float* const out{q} = read{q} + {offset_of(tuple(c))};" for q, c in enumerate(lattice.velocities.tolist())
    )


def out_table(lattice: Lattice, streaming: Streaming) -> str:
    """`out[q][n]`, for loops over q."""
    listed = ", ".join(f"out{q}" for q in range(len(lattice.weights)))
    return f"{read_pointers(lattice, streaming)}\n{out_pointers(lattice)}\nfloat* const out[] = {{{listed}}};"


def moments_of(lattice: Lattice, n: str, *, array: bool = True) -> str:
    """density and momentum_x, _y, _z of what cell n sends."""
    sent = [f"out[{q}][{n}]" if array else f"out{q}[{n}]" for q in range(len(lattice.weights))]
    lines = [f"const float density = 1.0f + {' + '.join(sent)};"]
    for axis, letter in enumerate("xyz"):
        terms = [f"{'+' if c > 0 else '-'} {g}" for g, c in zip(sent, lattice.velocities[:, axis], strict=True) if c]
        lines.append(f"const float momentum_{letter} = {' '.join(terms)};")
    return "\n".join(lines)


def equilibrium_table(lattice: Lattice) -> str:
    """Tables of the lattice and f_eq - w of density 1 + shift (Krueger et al. 2017, Eq. 3.4)."""
    q_count = len(lattice.weights)
    tables = [f"const float weight[] = {{{', '.join(f'{w:.9g}f' for w in lattice.weights.tolist())}}};"]
    for axis, letter in enumerate("xyz"):
        components = ", ".join(f"{c}.0f" for c in lattice.velocities[:, axis])
        tables.append(f"const float c{letter}[{q_count}] = {{{components}}};")
    return (
        "\n".join(tables)
        + """
        auto equilibrium = [&](int q, float shift, float ux, float uy, float uz) {
            const float cu = cx[q] * ux + cy[q] * uy + cz[q] * uz;
            const float squares = 4.5f * cu * cu - 1.5f * (ux * ux + uy * uy + uz * uz);
            return weight[q] * (shift + (1.0f + shift) * (3.0f * cu + squares));
        };
    """
    )


def mirror_table(lattice: Lattice) -> str:
    """Tables of the populations that bounce-back and mirrors (x: 1, y: 2, z: 4) send back; offsets of neighbours."""
    rows = []
    for flip in range(8):
        mirrored = lattice.mirrored((bool(flip & 1), bool(flip & 2), bool(flip & 4)))
        rows.append("{" + ", ".join(map(str, mirrored)) + "}")
    offsets = ", ".join(offset_of(tuple(c)) for c in lattice.velocities.tolist())
    return f"""
        const unsigned char opposite[] = {{{", ".join(map(str, lattice.opposite))}}};
        const unsigned char mirrored[8][{len(lattice.weights)}] = {{{", ".join(rows)}}};
        const int offset[] = {{{offsets}}};
    """


def image_cell() -> str:
    """`at`, number of the cell (at_i, at_j, at_k) that cell (i, j, k) of kind `what` stands for; `flip`: mirrored."""
    lines = [f"const int image = what & {IMAGE} ? what : 0, flip = image & 7;"]
    for axis, (i, n) in enumerate((("i", "nx"), ("j", "ny"), ("k", "nz"))):
        mirror = f"{i} == 0 ? 1 : {i} == {n} - 1 ? {n} - 2 : {i}"
        repeat = f"{i} == 0 ? {n} - 2 : {i} == {n} - 1 ? 1 : {i}"
        lines.append(f"const int at_{i} = image & {1 << axis} ? ({mirror}) : image & {16 << axis} ? ({repeat}) : {i};")
    return "\n".join([*lines, "const int at = (at_k * ny + at_j) * nx + at_i;"])
