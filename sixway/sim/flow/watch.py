"""Whether the air is still sane, found out on the device and asked for once a frame."""

import warp as wp

wp.set_module_options({"enable_backward": False})


class Watch:
    """Remembers the first lattice step at which some air was not finite or reached `limit` [cells/step]."""

    def __init__(self, *, limit: float, device: str) -> None:
        self._limit = limit
        self._first = wp.zeros(1, dtype=wp.int32, device=device)

    def look(self, velocity: wp.array, step: int) -> None:
        """Look at all velocities after lattice step `step` (> 0); no wait for the device."""
        flat = velocity.flatten()
        wp.launch(_look, dim=len(flat), inputs=[flat, self._limit, step, self._first], device=velocity.device)

    def broken_step(self) -> int | None:
        """The step of the first look that found something, None if all was well. Waits for the device."""
        return int(self._first.numpy()[0]) or None


@wp.kernel
def _look(velocity: wp.array[wp.vec3], limit: float, step: int, first: wp.array[wp.int32]):
    speed = wp.length(velocity[wp.tid()])
    if not (speed < limit) and first[0] == 0:  # also true of NaN; threads that write at once write the same
        first[0] = step
