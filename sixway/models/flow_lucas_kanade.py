"""Optical flow by pyramidal Lucas-Kanade (Lucas & Kanade 1981; Bouguet 2001): dense, differentiable, no weights."""

import torch
from jaxtyping import Float
from kornia.filters import gaussian_blur2d, spatial_gradient
from kornia.geometry.transform import pyrdown
from torch import Tensor, nn

from sixway.models.flow_warp import resized_flow, warp

_SMALLEST_SIDE_PX = 8


class LucasKanade(nn.Module):
    """How far every pixel of one picture has gone in the next.

    levels: of the pyramid, at most (none below 8 px); each doubles the reach, which is about 2 px at
    the coarsest. iterations: Gauss-Newton steps a level. window_px: sigma of the Gaussian window over
    which motion is taken as constant. Smoke that fades or folds breaks the assumption of constant
    brightness; this is an estimate, not the simulated motion.
    """

    name = "lucas_kanade"
    pretrained = False

    def __init__(self, *, levels: int = 4, iterations: int = 3, window_px: float = 1.6) -> None:
        super().__init__()
        if levels < 1 or iterations < 1 or not window_px > 0.0:
            raise ValueError(
                f"Lucas-Kanade needs levels ({levels}) and iterations ({iterations}) of at least 1 "
                f"and a window ({window_px} px) above 0"
            )
        self.levels = levels
        self.iterations = iterations
        self.window_px = window_px

    def forward(self, first: Float[Tensor, "n c h w"], second: Float[Tensor, "n c h w"]) -> Float[Tensor, "n 2 h w"]:
        """Flow [px; right, down] on the pixels of `first`: second(x + flow) is close to first(x)."""
        # fp32: the determinant below is a difference of products of small gradients
        with torch.autocast(first.device.type, enabled=False):
            pyramid = [(first.float(), second.float())]
            while len(pyramid) < self.levels and min(pyramid[-1][0].shape[2:]) >= 2 * _SMALLEST_SIDE_PX:
                pyramid.append((pyrdown(pyramid[-1][0]), pyrdown(pyramid[-1][1])))
            coarsest = pyramid[-1][0]
            flow = coarsest.new_zeros((coarsest.shape[0], 2, *coarsest.shape[2:]))
            for fine_first, fine_second in reversed(pyramid):
                flow = resized_flow(flow, height=fine_first.shape[2], width=fine_first.shape[3])
                for _ in range(self.iterations):
                    flow = self._blurred(flow + self._update(fine_first, warp(fine_second, flow)))
            return flow

    def _update(self, first: Tensor, second: Tensor) -> Tensor:
        """The step that least squares asks for in every window (Lucas & Kanade 1981), [n, 2, h, w]."""
        # the mean of both gradients: second-order accurate in the step
        gradient = 0.5 * (spatial_gradient(first) + spatial_gradient(second))
        right, down = gradient[:, :, 0], gradient[:, :, 1]
        change = second - first
        products = torch.stack([right * right, right * down, down * down, right * change, down * change], dim=1)
        rr, rd, dd, rc, dc = self._blurred(products.sum(dim=2)).split(1, dim=1)
        # a damping relative to the whole picture: flat parts stay still, at any brightness
        damping = 1e-3 * (rr + dd).mean(dim=(2, 3), keepdim=True) + 1e-8
        rr, dd = rr + damping, dd + damping
        determinant = rr * dd - rd * rd
        step = torch.cat([rd * dc - dd * rc, rd * rc - rr * dc], dim=1) / determinant
        return step.clamp(-self.window_px, self.window_px)

    def _blurred(self, values: Tensor) -> Tensor:
        size = 2 * round(2.0 * self.window_px) + 1
        return gaussian_blur2d(values, size, (self.window_px, self.window_px), border_type="replicate")
