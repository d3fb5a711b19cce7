"""A Warp kernel over all CPU threads: Warp runs it on one, but lets go of Python's lock meanwhile."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import warp as wp

_BANDS_A_THREAD = 8
"""Smoke sits in the middle of a picture, so one band a thread would leave most threads waiting."""


class RowBands:
    """Cuts a launch into bands of rows and hands them to a pool of threads; other devices get one launch.

    Kernels take the number of their first row as first argument. Bands write apart, so threads change no byte.
    """

    def __init__(self, device: wp.Device, *, threads: int) -> None:
        self._device = device
        self._threads = threads if device.is_cpu else 1
        self._helpers = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None

    def launch(
        self, kernel: wp.Kernel, *, dim: Sequence[int], inputs: Sequence[object], outputs: Sequence[wp.array]
    ) -> None:
        """Run `kernel` over `dim`, rows first, and wait for all bands."""
        self.record(kernel, dim=dim, inputs=inputs, outputs=outputs)()

    def record(
        self, kernel: wp.Kernel, *, dim: Sequence[int], inputs: Sequence[object], outputs: Sequence[wp.array]
    ) -> Callable[[], None]:
        """The launch with these very arguments, ready to run often: that costs a fifth of `launch`."""
        rows, *others = dim
        height = -(-rows // (_BANDS_A_THREAD * self._threads)) if self._helpers else rows
        bands = [
            wp.launch(
                kernel,
                dim=(min(height, rows - row), *others),
                inputs=[row, *inputs],
                outputs=outputs,
                device=self._device,
                record_cmd=True,  # this also loads the module, which is not safe from several threads
            )
            for row in range(0, rows, height)
        ]
        return lambda: self._run(bands)

    def _run(self, bands: Sequence[wp.Launch]) -> None:
        left = iter(bands)

        def take_bands() -> None:
            for band in left:  # a list's iterator hands every band to one thread only
                band.launch()

        # this thread works too: one helper fewer to wake, and short launches are over before it arrives
        helping = [self._helpers.submit(take_bands) for _ in range(self._threads - 1)] if self._helpers else []
        take_bands()
        for helper in helping:
            helper.result()
