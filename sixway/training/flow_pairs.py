"""Pairs of smoke pictures with the flow between them, drawn from clips.

The simulator's motion is a mean over layers that move apart, and smoke that streams steadily looks still: it does not
say how the picture changes. So the first picture of a pair is made from the second by that motion, and the flow is
exact. A part of the real first picture mixed in brings the changes that no flow explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from sixway.core.color import encode_srgb
from sixway.models.flow_warp import resized_flow, warp
from sixway.training.flow_data import Clip

_WHITE_PERCENTILE = 99.9


@dataclass(frozen=True)
class FlowPairs:
    """Two pictures (sRGB code), the flow from first to second [px; right, down], and how opaque the first is."""

    first: Float[Tensor, "n 1 h w"]
    second: Float[Tensor, "n 1 h w"]
    flow: Float[Tensor, "n 2 h w"]
    alpha: Float[Tensor, "n 1 h w"]

    def __len__(self) -> int:
        return len(self.first)


class MovingClip:
    """A clip as tensors, bright as a dataset has it: the 99.9th percentile is 1."""

    def __init__(self, clip: Clip) -> None:
        pictures = torch.from_numpy(clip.pictures).float()[:, None]
        self.pictures = pictures / max(float(np.percentile(pictures.numpy(), _WHITE_PERCENTILE)), 1e-6)
        self.motion = torch.from_numpy(clip.motion).float()
        self.alpha = torch.from_numpy(clip.alpha).float()[:, None]
        self.spread = torch.from_numpy(clip.spread).float()[:, None]

    def __len__(self) -> int:
        return len(self.pictures)

    def flow(self, frame: int, stride: int) -> Float[Tensor, "1 2 h w"]:
        """Motion of the smoke seen in `frame` until `stride` frames later: along the path, midpoint by midpoint."""
        total = torch.zeros_like(self.motion[:1])
        for now in range(frame, frame + stride):
            here, then = self.motion[now : now + 1], self.motion[now + 1 : now + 2]
            total = total + warp(0.5 * (here + warp(then, here)), total)
        return total


def simulated_pair(clip: MovingClip, frame: int, stride: int) -> FlowPairs:
    """Two frames as they are, and the simulator's motion between them."""
    first, second = (functional.avg_pool2d(clip.pictures[i][None], 2) for i in (frame, frame + stride))
    alpha = clip.alpha[frame][None]
    return FlowPairs(encode_srgb(first), encode_srgb(second), clip.flow(frame, stride), alpha)


def moved_pair(
    clip: MovingClip,
    frame: int,
    stride: int,
    *,
    real_share: float = 0.0,
    drift: Float[Tensor, "1 2 h w"] | None = None,
) -> FlowPairs:
    """A frame, and what it was like `stride` frames before if all of its change were the simulator's motion.

    real_share: of the frame that really came before. drift: a further flow of the whole picture. Linear light is
    moved, at the clip's full size, and made smaller then.
    """
    seen = torch.maximum(clip.alpha[frame], clip.alpha[frame + stride])[None]
    flow = spread_out(clip.flow(frame, stride), seen)
    second = clip.pictures[frame + stride][None]
    side = second.shape[-1]
    first = warp(second, resized_flow(flow, height=side, width=side))
    first = torch.lerp(first, clip.pictures[frame][None], real_share)
    alpha = warp(clip.alpha[frame + stride][None], flow)
    if drift is not None:
        first = warp(first, resized_flow(drift, height=side, width=side))
        flow = drift + warp(flow, drift)
        alpha = warp(alpha, drift)
    first, second = (functional.avg_pool2d(picture, 2) for picture in (first, second))
    return FlowPairs(encode_srgb(first), encode_srgb(second), flow, alpha)


def spread_out(flow: Float[Tensor, "n 2 h w"], weight: Float[Tensor, "n 1 h w"]) -> Float[Tensor, "n 2 h w"]:
    """The flow where it has weight; elsewhere the weighted mean of ever wider surroundings."""

    def filled(weighted: Tensor, weight: Tensor) -> Tensor:
        around = torch.zeros_like(weighted)
        if max(weight.shape[2:]) > 1:
            coarse = filled(*(functional.avg_pool2d(field, 2, ceil_mode=True) for field in (weighted, weight)))
            around = functional.interpolate(coarse, size=weight.shape[2:], mode="bilinear", align_corners=False)
        return (weighted + _FAINT * around) / (weight + _FAINT)

    return filled(flow * weight, weight)


_FAINT = 0.1
"""Weight of the surroundings: it also softens tears where layers move apart."""


class PairSampler:
    """Draws training pairs at random: strides, drifts, mirrors, brightness, noise, and a crop around the smoke."""

    def __init__(self, clips: Sequence[MovingClip], *, most_stride: int, crop_px: int) -> None:
        if not clips:
            raise ValueError("there are no clips to draw pairs from; give a source of that split")
        shortest = min(map(len, clips))
        if not 1 <= most_stride < shortest:
            raise ValueError(f"most_stride={most_stride} must be at least 1 and below the {shortest} frames of a clip")
        self.clips = clips
        self.most_stride = most_stride
        self.crop_px = min(crop_px, *clips[0].motion.shape[-2:])

    def batch(self, rng: np.random.Generator, *, size: int) -> FlowPairs:
        pairs = [self._pair(rng) for _ in range(size)]
        return FlowPairs(*(torch.cat([getattr(pair, name) for pair in pairs]) for name in _FIELDS))

    def _pair(self, rng: np.random.Generator) -> FlowPairs:
        clip = self.clips[int(rng.integers(len(self.clips)))]
        stride = int(rng.integers(0, self.most_stride + 1))
        frame = int(rng.integers(0, len(clip) - stride))
        drift = _drift(rng, *clip.motion.shape[-2:]) if rng.random() < 0.5 or stride == 0 else None
        real_share = rng.uniform(0.0, 0.4) if rng.random() < 0.5 else 0.0
        pair = moved_pair(clip, frame, stride, real_share=real_share, drift=drift)
        return _relit(rng, _mirrored(rng, self._cropped(rng, pair)))

    def _cropped(self, rng: np.random.Generator, pair: FlowPairs) -> FlowPairs:
        """A crop whose centre lies on the smoke as often as the smoke covers the picture there."""
        height, width = pair.alpha.shape[2:]
        weight = pair.alpha.flatten().double().numpy() + 1e-6
        y, x = divmod(int(rng.choice(weight.size, p=weight / weight.sum())), width)
        top = int(np.clip(y - self.crop_px // 2, 0, height - self.crop_px))
        left = int(np.clip(x - self.crop_px // 2, 0, width - self.crop_px))
        window = np.s_[..., top : top + self.crop_px, left : left + self.crop_px]
        return FlowPairs(*(getattr(pair, name)[window] for name in _FIELDS))


_FIELDS = ("first", "second", "flow", "alpha")


def _drift(rng: np.random.Generator, height: int, width: int) -> Tensor:
    """A shift of some px, a turn and a growth of some percent about the centre."""
    shift = rng.normal(0.0, 1.5, size=2)
    turn, growth = rng.normal(0.0, 0.03, size=2)
    y, x = np.mgrid[:height, :width]
    y, x = y - 0.5 * (height - 1), x - 0.5 * (width - 1)
    drift = np.stack([shift[0] + growth * x - turn * y, shift[1] + growth * y + turn * x])
    return torch.from_numpy(drift.astype(np.float32))[None]


def _mirrored(rng: np.random.Generator, pair: FlowPairs) -> FlowPairs:
    """One of the eight ways to lay a square picture."""
    across, down, swap = (rng.random() < 0.5 for _ in range(3))
    flips = [axis for axis, flip in ((3, across), (2, down)) if flip]
    signs = torch.tensor([-1.0 if across else 1.0, -1.0 if down else 1.0]).reshape(1, 2, 1, 1)

    def laid(field: Tensor) -> Tensor:
        field = field.flip(flips)
        return field.transpose(2, 3) if swap else field

    flow = laid(pair.flow * signs)
    return FlowPairs(laid(pair.first), laid(pair.second), flow.flip(1) if swap else flow, laid(pair.alpha))


def _relit(rng: np.random.Generator, pair: FlowPairs) -> FlowPairs:
    """Brighter or darker, changing smoothly from first to second, with the noise of a reference."""
    exposure = rng.uniform(0.2, 1.1)
    strength, noise = rng.uniform(0.0, 0.08), rng.uniform(0.0, 0.01)
    coarse = torch.from_numpy(rng.normal(1.0, strength, size=(1, 1, 3, 3)).astype(np.float32))
    change = functional.interpolate(coarse, size=pair.first.shape[2:], mode="bicubic", align_corners=False)

    def noisy(picture: Tensor) -> Tensor:
        grain = torch.from_numpy(rng.standard_normal(picture.shape, dtype=np.float32))
        return (picture + noise * grain * picture.sqrt()).clamp_min(0.0)

    first, second = noisy(exposure * pair.first), noisy(exposure * change * pair.second)
    return FlowPairs(first, second, pair.flow, pair.alpha)


def endpoint_error(
    flow: Float[Tensor, "n 2 h w"], truth: Float[Tensor, "n 2 h w"], alpha: Float[Tensor, "n 1 h w"]
) -> Float[Tensor, " n"]:
    """Mean distance of flow and truth over the smoke [px], each pixel weighted by its opacity; one a pair."""
    distance = (flow - truth).norm(dim=1, keepdim=True)
    return (distance * alpha).sum(dim=(1, 2, 3)) / alpha.sum(dim=(1, 2, 3)).clamp_min(1.0)
