# mypy: ignore-errors
"""Warp kernels that change scalars in place, voxel by voxel: sources, fading, cooling."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def feed(first: int, source: wp.array[wp.float32], solid: wp.array[wp.uint8], field: wp.array[wp.float32]):
    """Raise a field to its source outside obstacles."""
    n = first + wp.tid()
    if source[n] > field[n] and int(solid[n]) == 0:
        field[n] = source[n]


@wp.kernel
def scale(first: int, factor: float, field: wp.array[wp.float32]):
    n = first + wp.tid()
    field[n] = factor * field[n]


@wp.kernel
def cool(first: int, factor: float, radiated: float, temperature: wp.array[wp.float32]):
    """Linear loss, then radiation dT/dt = -c T^4, each by its exact solution; radiated: 3 c dt [1/K^3]."""
    n = first + wp.tid()
    hot = factor * temperature[n]
    if hot > 0.0 and radiated > 0.0:
        hot = hot / wp.pow(1.0 + radiated * hot * hot * hot, 1.0 / 3.0)
    temperature[n] = hot
