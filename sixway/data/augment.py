"""Exact flips: a mirrored view of smoke is a view of mirrored smoke, with two of its maps exchanged.

A horizontal flip exchanges left and right, a vertical one top and bottom, in guide and target alike;
the sum of front, top and bottom light stays. A quarter turn is no symmetry of that guide.
"""

from collections.abc import Collection

from jaxtyping import Float
from torch import Tensor

from sixway.core.conventions import FLIP_HORIZONTAL, FLIP_VERTICAL, LIGHTMAP_CHANNELS
from sixway.data.clips import Batch


def flip_channels(channels: tuple[str, ...], exchange: dict[str, str]) -> list[int]:
    """Index of the channel that each flipped channel is read from.

    Raises ValueError if a channel's partner is absent: that guide has no such symmetry.
    """
    partners = [exchange.get(name, name) for name in channels]
    missing = [name for name in partners if name not in channels]
    if missing:
        raise ValueError(f"channels {channels} cannot be flipped: {missing} are absent; switch flips off")
    return [channels.index(name) for name in partners]


def check_summed_lights(lights: Collection[str]) -> None:
    """Raise ValueError unless a sum over these lights stays what it is when the picture is flipped."""
    partners = {exchange.get(light, light) for light in lights for exchange in (FLIP_HORIZONTAL, FLIP_VERTICAL)}
    missing = sorted(partners - set(lights))
    if missing:
        raise ValueError(
            f"a guide that sums the lights {tuple(lights)} cannot be flipped: {missing} are absent; switch flips off"
        )


def flip_image(
    images: Float[Tensor, "n c h w"], channels: tuple[str, ...], *, horizontal: bool, vertical: bool
) -> Float[Tensor, "n c h w"]:
    """Flip pictures and exchange the channels that the flip exchanges."""
    if horizontal:
        images = images[:, flip_channels(channels, FLIP_HORIZONTAL)].flip(-1)
    if vertical:
        images = images[:, flip_channels(channels, FLIP_VERTICAL)].flip(-2)
    return images


def flip_flow(flow: Float[Tensor, "p 2 h w"], *, horizontal: bool, vertical: bool) -> Float[Tensor, "p 2 h w"]:
    """Flip a field of motion [px; right, down]: what went right goes left, what went down goes up."""
    if horizontal:
        flow = flow.flip(-1) * flow.new_tensor([-1.0, 1.0])[:, None, None]
    if vertical:
        flow = flow.flip(-2) * flow.new_tensor([1.0, -1.0])[:, None, None]
    return flow


def flip_pair(pair: Batch, guide_channels: tuple[str, ...], *, horizontal: bool, vertical: bool) -> Batch:
    """Flip guide, target and flow of every frame alike."""
    return Batch(
        guide=flip_image(pair.guide, guide_channels, horizontal=horizontal, vertical=vertical),
        target=flip_image(pair.target, LIGHTMAP_CHANNELS, horizontal=horizontal, vertical=vertical),
        flow=None if pair.flow is None else flip_flow(pair.flow, horizontal=horizontal, vertical=vertical),
    )
