"""Collision models as generated C++: straight lines over one cell's populations, which a compiler can vectorise.

`text` is pasted into a row loop (`sixway.sim.flow.generated.air`). It reads the pulled populations `f0`, `f1`, ...
(shifted by their weights, which keeps float32's digits for what differs from air at rest, Krueger et al. 2017,
Sec. 4.3.1), the acceleration `ax`, `ay`, `az` [cells/step^2], the relaxation time `tau` [steps] of the molecular
viscosity and Smagorinsky's constant `smagorinsky`; it overwrites `f0`, ... with the populations after collision and
declares `rho`, `ux`, `uy`, `uz`: density and velocity [cells/step] in the middle of the step, half of the force
included. Its own names start with `t_`. The float64 twins are in `sixway.sim.flow.collision_oracle`.
"""

from collections.abc import Collection, Iterable, Iterator
from itertools import product

from sixway.sim.flow.lattice import CollisionModel, Lattice

AXES = "xyz"
PLANES = (("x", "x"), ("y", "y"), ("z", "z"), ("x", "y"), ("x", "z"), ("y", "z"))
"""The six components of a symmetric tensor, in the order in which they are stored."""

Orders = tuple[int, ...]
"""Powers (x, y, z) of a Hermite polynomial, each 0, 1 or 2: one D3Q27 moment."""

ALL_ORDERS: tuple[Orders, ...] = tuple(product((0, 1, 2), repeat=3))
THIRD_ORDER = tuple(n for n in ALL_ORDERS if sum(n) <= 3)


def text(lattice: Lattice, model: CollisionModel) -> str:
    """C++ of one cell's collision. All models take Smagorinsky's eddy viscosity and force to second order.

    bgk: one rate for all moments, equilibrium to second order in u (Qian et al. 1992). Cheapest, for flows that the
        grid resolves or an eddy viscosity smooths: it diverges at vanishing viscosity unless `smagorinsky` is 0.1 or
        more, and without it in the lid-driven cavity at Re 1000 on 64 cells where the lid's corners are still walls.
        With 0.1, jets at vanishing viscosity still carry waves of two cells nearly as strong as in noise.
    regularised: Hermite moments about the velocity: the shear relaxes by `tau` and `smagorinsky`, all else at once,
        the trace of the stress too (recursive regularisation, Malaspinas 2015; Coreixas et al. 2019). On D3Q27 clean
        at vanishing viscosity without an eddy viscosity; D3Q19, which lacks moments, then diverges unless
        `smagorinsky` is 0.1. With the trace relaxed at the rate of the shear, as these papers have it, an alternation
        from cell to cell grows along a sliding wall, and the cavity at Re 1000 breaks up.
    third_order: the same with the Hermite series of the populations cut after the third order (Li et al. 2023), D3Q27
        only. The population twin of `sixway.sim.moments`.

    Raises ValueError for third_order on D3Q19, which cannot tell third-order moments apart.
    """
    lines = [*moments(lattice)]
    match model, lattice.name:
        case "bgk", _:
            lines += [*_bgk(lattice)]
        case "regularised", "D3Q27":
            lines += [*relaxed(), *hermite(ALL_ORDERS), *_populations_27(lattice, ALL_ORDERS)]
        case "regularised", "D3Q19":
            lines += [*relaxed(), *hermite([n for n in ALL_ORDERS if 0 in n]), *_populations_19(lattice)]
        case "third_order", "D3Q27":
            lines += [*relaxed(), *hermite(THIRD_ORDER), *_populations_27(lattice, THIRD_ORDER)]
        case _:
            raise ValueError(f"collision model {model!r} on {lattice.name}: it needs D3Q27")
    return "\n".join(lines)


def moments(lattice: Lattice) -> Iterator[str]:
    """rho, u, the stress about u less rho / 3 on the diagonal, and its rate of relaxation `t_rate`.

    A force makes u differ from the momentum j of the populations by half of itself (Guo et al. 2002, Eq. 3), so
    sum (c - u)(c - u) f = sum c c f - (u k + k u) / 2 with k = j - F / 2. The rate is 1 / tau with Smagorinsky's eddy
    viscosity, closed form from the stress (Hou et al. 1996).
    """
    pairs = _pairs(lattice)
    for q, o in pairs:
        yield f"const float t_even{q} = f{q} + f{o}, t_odd{q} = f{q} - f{o};"
    velocity = {q: dict(zip(AXES, map(int, lattice.velocities[q]), strict=True)) for q, _ in pairs}
    yield f"const float t_shift = {_sum([(1, 'f0'), *((1, f't_even{q}') for q, _ in pairs)])};"
    yield "const float rho = 1.0f + t_shift, t_volume = 1.0f / rho;"
    for a in AXES:
        yield f"const float t_j{a} = {_sum((velocity[q][a], f't_odd{q}') for q, _ in pairs)};"
        yield f"const float u{a} = t_j{a} * t_volume + 0.5f * a{a}, t_k{a} = t_j{a} - 0.5f * rho * a{a};"
    for a, b in PLANES:
        raw = _sum((velocity[q][a] * velocity[q][b], f"t_even{q}") for q, _ in pairs)
        if a == b:
            yield f"const float t_s{a}{b} = {raw} - {_number(1 / 3)} * t_shift - u{a} * t_k{a};"
        else:
            yield f"const float t_s{a}{b} = {raw} - 0.5f * (u{a} * t_k{b} + u{b} * t_k{a});"
    yield "const float t_norm = sqrtf(t_sxx * t_sxx + t_syy * t_syy + t_szz * t_szz"
    yield "    + 2.0f * (t_sxy * t_sxy + t_sxz * t_sxz + t_syz * t_syz));"
    eddy = _number(18 * 2**0.5)
    yield f"const float t_eddy = {eddy} * smagorinsky * smagorinsky * t_norm * t_volume;"
    yield "const float t_rate = 2.0f / (tau + sqrtf(tau * tau + t_eddy));"
    yield "const float t_keep = 1.0f - t_rate;"


def relaxed() -> Iterator[str]:
    """Velocity v at the end of the step and relaxed stress p about it: a force moves the frame, not the stress.

    Its trace goes at once. The stress about u is t_keep times what it was (a force adds nothing to second central
    moments, Fei & Luo 2017); about v = u + a / 2 it is less by rho a a / 4.
    """
    for a in AXES:
        yield f"const float t_v{a} = u{a} + 0.5f * a{a};"
    yield f"const float t_trace = {_number(1 / 3)} * (t_sxx + t_syy + t_szz);"
    for a, b in PLANES:
        shear = f"(t_s{a}{b} - t_trace)" if a == b else f"t_s{a}{b}"
        yield f"const float t_p{a}{b} = t_keep * {shear} - 0.25f * rho * a{a} * a{b};"


def hermite(orders: Collection[Orders]) -> Iterator[str]:
    """Hermite moments `t_a<powers>` of the populations of rho, v and p whose central ones vanish beyond the stress.

    a_n = (rho + p_ab d_a d_b / 2) v^n: the recursion of Malaspinas 2015 in closed form, its third order that of Li et
    al. 2023. The moment of order 0 is shifted like the populations.
    """
    for n in ALL_ORDERS[1:]:  # v^n; the compiler drops what nobody uses
        axis = next(a for a in range(3) if n[a])
        rest = _less(n, axis)
        factor = f" * t_w{_digits(rest)}" if any(rest) else ""
        yield f"const float t_w{_digits(n)} = t_v{AXES[axis]}{factor};"
    for n in orders:
        terms = [f"rho * t_w{_digits(n)}"]
        for a, b in PLANES:
            i, j = AXES.index(a), AXES.index(b)
            count = n[i] * n[j] if i != j else n[i] * (n[i] - 1) // 2
            if count:
                rest = _less(_less(n, i), j)
                factors = [*([f"{count}.0f"] if count > 1 else []), f"t_p{a}{b}"]
                terms.append(" * ".join(factors + ([f"t_w{_digits(rest)}"] if any(rest) else [])))
        yield f"const float t_a{_digits(n)} = {' + '.join(terms) if any(n) else 't_shift'};"


def population(velocity: Iterable[int], orders: Collection[Orders]) -> str:
    """The one shifted population along `velocity`, of the Hermite moments t_a."""
    terms = []
    for n in orders:
        factor = 1.0
        for power, c in zip(n, velocity, strict=True):
            factor *= _BASIS[power][abs(c)] * (c if power == 1 else 1)
        if factor:
            terms.append(f"{_number(factor)} * t_a{_digits(n)}")
    return " + ".join(terms)


_BASIS = {0: (2 / 3, 1 / 6), 1: (0.0, 1 / 2), 2: (-1.0, 1 / 2)}
"""w(c) H_n(c) / |H_n|^2 of D1Q3 at |c| = 0 and 1; odd n changes sign with c."""


def _bgk(lattice: Lattice) -> Iterator[str]:
    """g - rate (g - g_eq) + (1 - rate / 2) G with Guo's force term G, the new parts gathered by powers of c.

    With m = rate rho u + (1 - rate / 2) F and n = rate rho u + (2 - rate) F they are
    w (rate shift - 1.5 u.n + 4.5 c.u c.n + 3 c.m): an even part and an odd one, shared by a pair.
    """
    for a in AXES:
        yield f"const float t_b{a} = t_rate * rho * u{a}, t_d{a} = (2.0f - t_rate) * rho * a{a};"
        yield f"const float t_n{a} = t_b{a} + t_d{a}, t_m{a} = t_b{a} + 0.5f * t_d{a};"
    yield "const float t_rest = t_rate * t_shift - 1.5f * (ux * t_nx + uy * t_ny + uz * t_nz);"
    yield f"f0 = t_keep * f0 + {_number(lattice.weights[0])} * t_rest;"
    for q, o in _pairs(lattice):
        along = [(int(c), a) for a, c in zip(AXES, lattice.velocities[q], strict=True)]
        u, m, n = (_sum((c, f"{name}{a}") for c, a in along) for name in ("u", "t_m", "t_n"))
        yield f"const float t_e{q} = {_number(lattice.weights[q])} * (t_rest + 4.5f * ({u}) * ({n}));"
        yield f"const float t_o{q} = {_number(3 * lattice.weights[q])} * ({m});"
        yield f"f{q} = t_keep * f{q} + t_e{q} + t_o{q}; f{o} = t_keep * f{o} + t_e{q} - t_o{q};"


def _populations_27(lattice: Lattice, orders: Collection[Orders]) -> Iterator[str]:
    """The Hermite series, summed along x, then y, then z: f = sum_n a_n w H_n / |H_n|^2."""
    names = {n: f"t_a{_digits(n)}" for n in orders}
    for axis, letter in enumerate(AXES):
        summed: dict[Orders, str] = {}
        for rest in {(*n[:axis], 0, *n[axis + 1 :]): None for n in names}:
            keys = [(*rest[:axis], c, *rest[axis + 1 :]) for c in (0, 1, 2)]
            c0, c1, c2 = (names.get(key) for key in keys)
            stem = f"t_{letter}{_digits(rest)}"
            even = f"{_number(1 / 6)} * {c0}" + (f" + 0.5f * {c2}" if c2 else "")
            odd = f"0.5f * {c1}" if c1 else "0.0f"
            yield f"const float {stem}_e = {even}, {stem}_o = {odd};"
            yield f"const float {stem}_0 = {_number(2 / 3)} * {c0}" + (f" - {c2};" if c2 else ";")
            yield f"const float {stem}_1 = {stem}_e + {stem}_o, {stem}_2 = {stem}_e - {stem}_o;"
            summed |= {key: f"{stem}_{c}" for c, key in enumerate(keys)}
        names = summed
    for q, c in enumerate(lattice.velocities.tolist()):
        x, y, z = (part % 3 for part in c)  # the place of -1 is 2
        yield f"f{q} = {names[x, y, z]};"


def _populations_19(lattice: Lattice) -> Iterator[str]:
    """From the raw moments `t_m<powers>`, of which a population on an edge has four and one on a face seven."""
    number_of = {tuple(c): q for q, c in enumerate(lattice.velocities.tolist())}

    def moment(**powers: int) -> str:
        return "".join(str(powers.get(a, 0)) for a in AXES)

    for n in (n for n in ALL_ORDERS if 0 in n and any(n)):
        lower = [(_less(_less(n, a), a), 1 / 3) for a in range(3) if n[a] == 2]
        if len(lower) == 2:
            lower.append(((0, 0, 0), 1 / 9))
        terms = [f"t_a{_digits(n)}", *(f"{_number(factor)} * t_a{_digits(key)}" for key, factor in lower)]
        yield f"const float t_m{_digits(n)} = {' + '.join(terms)};"
    for a, b in PLANES[3:]:
        m22, m12, m21, m11 = (moment(**{a: i, b: j}) for i, j in ((2, 2), (1, 2), (2, 1), (1, 1)))
        for s, t in product((1, -1), repeat=2):
            c = tuple({a: s, b: t}.get(axis, 0) for axis in AXES)
            total = _sum([(1, f"t_m{m22}"), (s, f"t_m{m12}"), (t, f"t_m{m21}"), (s * t, f"t_m{m11}")])
            yield f"f{number_of[c]} = 0.25f * ({total});"
    for a in AXES:
        b, d = (other for other in AXES if other != a)
        yield f"const float t_e{a} = t_m{moment(**{a: 2})} - t_m{moment(**{a: 2, b: 2})} - t_m{moment(**{a: 2, d: 2})};"
        yield f"const float t_o{a} = t_m{moment(**{a: 1})} - t_m{moment(**{a: 1, b: 2})} - t_m{moment(**{a: 1, d: 2})};"
        for s, sign in ((1, "+"), (-1, "-")):
            c = tuple(s if axis == a else 0 for axis in AXES)
            yield f"f{number_of[c]} = 0.5f * (t_e{a} {sign} t_o{a});"
    yield "f0 = t_shift - (t_m200 + t_m020 + t_m002) + (t_m220 + t_m202 + t_m022);"


def _pairs(lattice: Lattice) -> list[tuple[int, int]]:
    """Opposite populations (q, q'), each pair once: their sum has all even moments, their difference all odd ones."""
    return [(q, int(o)) for q, o in enumerate(lattice.opposite) if q < o]


def _less(n: Orders, axis: int) -> Orders:
    """n with one power of an axis less."""
    return tuple(power - (a == axis) for a, power in enumerate(n))


def _digits(n: Orders) -> str:
    return "".join(map(str, n))


def _number(value: float) -> str:
    """A float32 literal."""
    digits = f"{float(value):.9g}"
    return f"{digits}f" if {".", "e"} & set(digits) else f"{digits}.0f"


def _sum(terms: Iterable[tuple[int, str]]) -> str:
    """+-1 times names, as C++; terms of factor 0 are left out. Summed by halves: short chains, small rounding."""
    kept = [(factor, name) for factor, name in terms if factor]
    if len(kept) > 3:
        half = len(kept) // 2
        return f"({_sum(kept[:half])}) + ({_sum(kept[half:])})"
    return " ".join(f"{'-' if factor < 0 else '+'} {name}" for factor, name in kept).removeprefix("+ ")
