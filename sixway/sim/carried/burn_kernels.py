# mypy: ignore-errors
"""Warp kernels of `sixway.sim.carried.burn`: arithmetic only, twins in `sixway.sim.carried.oracle`."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def react(
    first: int,
    refinement: int,
    ignition: float,
    burnt_part: float,
    heat: float,
    hottest: float,
    soot: float,
    expansion: float,
    most_growth: float,
    steps: float,
    aged: float,
    density: wp.array3d[wp.float32],
    temperature: wp.array3d[wp.float32],
    fuel: wp.array3d[wp.float32],
    flame: wp.array3d[wp.float32],
    mass_source: wp.array3d[wp.float32],
):
    """Burn all voxels of a velocity cell; the cell's growth a step is the mean of its voxels'."""
    row, cj, ci = wp.tid()
    ck = first + row
    total = float(0.0)
    for c in range(refinement):
        for b in range(refinement):
            for a in range(refinement):
                k = ck * refinement + c
                j = cj * refinement + b
                i = ci * refinement + a
                lit = wp.max(flame[k, j, i] - aged, 0.0)
                left = fuel[k, j, i]
                if left > 0.0 and temperature[k, j, i] >= ignition:
                    burnt = burnt_part * left
                    growth = wp.min(expansion * burnt / steps, most_growth)
                    thinner = wp.exp(-growth * steps)
                    lit = wp.max(lit, wp.min(left, 1.0))
                    fuel[k, j, i] = (left - burnt) * thinner
                    density[k, j, i] = (density[k, j, i] + soot * burnt) * thinner
                    before = temperature[k, j, i]
                    temperature[k, j, i] = wp.max(before, wp.min(before + heat * burnt, hottest))
                    total += growth
                flame[k, j, i] = lit
    mass_source[ck + 1, cj + 1, ci + 1] = total / float(refinement * refinement * refinement)


@wp.kernel
def glow(
    first: int,
    emission_per_m: float,
    ambient: float,
    hottest: float,
    flame: wp.array[wp.float32],
    temperature: wp.array[wp.float32],
    emission: wp.array[wp.float32],
):
    n = first + wp.tid()
    ratio = (ambient + temperature[n]) / hottest
    emission[n] = emission_per_m * flame[n] * ratio * ratio * ratio * ratio
