"""The net: shapes at any size, what a new net answers, gradients, precision, learning."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from torch import Tensor

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.models.conditioning import GuideConditioning
from sixway.models.encoding import decode_lightmap, encode_lightmap
from sixway.models.unet import SixWayUNet, UNetConfig

SIX_LIGHTS = (*DIRECTIONS, "transmittance", "depth")
PAPER = ("in_scatter", "transmittance", "depth")
TINY = UNetConfig(widths=(4, 6, 8), adapter_width=4)
SCALE = 1.7


def make_net(config: UNetConfig = TINY, *, guide_channels: tuple[str, ...] = SIX_LIGHTS) -> SixWayUNet:
    torch.manual_seed(3)
    return SixWayUNet(config, guide_channels=guide_channels, guide_scale=SCALE).eval()


def empty_guide(channels: tuple[str, ...], height: int, width: int) -> Tensor:
    guide = torch.zeros(1, len(channels), height, width)
    guide[:, channels.index("transmittance")] = 1.0
    return guide


def smoky_guide(channels: tuple[str, ...], height: int, width: int) -> Tensor:
    return torch.rand(1, len(channels), height, width, generator=torch.Generator().manual_seed(5))


@settings(max_examples=12, deadline=None)
@given(
    height=st.integers(1, 50),
    width=st.integers(1, 50),
    batch=st.integers(1, 3),
    channels=st.sampled_from([SIX_LIGHTS, PAPER, ("depth", "front", "transmittance")]),
)
def test_any_size_keeps_its_size(height: int, width: int, batch: int, channels: tuple[str, ...]) -> None:
    guide = torch.rand(batch, len(channels), height, width)
    assert make_net(guide_channels=channels)(guide).shape == (batch, 8, height, width)


def test_an_odd_size_with_the_default_net(device: str) -> None:
    net = make_net(UNetConfig()).to(device)
    lightmap = net(smoky_guide(SIX_LIGHTS, 130, 97).to(device))
    assert lightmap.shape == (1, 8, 130, 97) and torch.isfinite(lightmap).all()


def test_without_correction_the_answer_is_the_guide() -> None:
    net = make_net()
    for adapter in net.adapters:
        torch.nn.init.zeros_(adapter.head.weight)
    guide = smoky_guide(SIX_LIGHTS, 20, 24)
    lightmap = net(guide)
    for channel in DIRECTIONS:
        expected = encode_srgb(SCALE * guide[:, SIX_LIGHTS.index(channel)])
        torch.testing.assert_close(lightmap[:, LIGHTMAP_CHANNELS.index(channel)], expected)
    torch.testing.assert_close(
        lightmap[:, LIGHTMAP_CHANNELS.index("alpha")], 1.0 - guide[:, SIX_LIGHTS.index("transmittance")]
    )
    assert lightmap[:, LIGHTMAP_CHANNELS.index("emissive")].abs().max() == 0.0


@pytest.mark.parametrize("channel", LIGHTMAP_CHANNELS)
def test_every_channel_has_its_adapter(channel: str) -> None:
    """A bias on one adapter's head moves the named channel and no other."""
    pairs = [("front", "back"), ("left", "right"), ("top", "bottom"), ("alpha", "emissive")]
    number, place = next((i, pair.index(channel)) for i, pair in enumerate(pairs) if channel in pair)
    net, guide = make_net(), smoky_guide(SIX_LIGHTS, 16, 16)
    before = net(guide)
    net.adapters[number].head.bias.data[4 * place : 4 * place + 4] += 1.0  # type: ignore[union-attr, index, operator]
    moved = (net(guide) - before).mean(dim=(0, 2, 3))
    expected = torch.tensor([float(name == channel) for name in LIGHTMAP_CHANNELS])
    torch.testing.assert_close(moved, expected)


def test_a_new_net_leaves_empty_space_empty() -> None:
    assert make_net()(empty_guide(SIX_LIGHTS, 13, 19)).abs().max() < 1e-6


def test_padding_is_nearly_an_empty_border() -> None:
    """What the net pads with is empty space; convolutions that end at the border leave a small difference."""
    net = make_net(UNetConfig())
    inner = smoky_guide(SIX_LIGHTS, 21, 18)
    bordered = empty_guide(SIX_LIGHTS, 21 + 16, 18 + 32)
    bordered[:, :, :21, :18] = inner
    difference = net(bordered)[:, :, :21, :18] - net(inner)
    assert difference.abs().mean() < 0.01


def test_conditioned_empty_space_is_zero() -> None:
    conditioning = GuideConditioning(SIX_LIGHTS, scale=SCALE)
    assert conditioning(empty_guide(SIX_LIGHTS, 4, 5)).abs().max() < 1e-6


def test_the_scale_travels_with_the_state() -> None:
    other = SixWayUNet(TINY, guide_channels=SIX_LIGHTS, guide_scale=1.0)
    other.load_state_dict(make_net().state_dict())
    assert float(other.conditioning.scale) == pytest.approx(SCALE)


@pytest.mark.parametrize("guide", [torch.zeros(1, 8, 20, 20), empty_guide(SIX_LIGHTS, 20, 20)])
def test_gradients_are_finite_on_a_black_guide(guide: Tensor) -> None:
    net = make_net().train()
    guide = guide.clone().requires_grad_()
    (net(guide) - 0.5).square().mean().backward()
    assert guide.grad is not None and torch.isfinite(guide.grad).all()
    for parameter in net.parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all()


def test_bfloat16_autocast_stays_near_float32() -> None:
    net = make_net(UNetConfig())
    guide = smoky_guide(SIX_LIGHTS, 32, 48)
    with torch.no_grad(), torch.autocast("cpu", dtype=torch.bfloat16):
        half = net(guide)
    assert half.dtype == torch.float32
    assert (half - net(guide)).abs().max() < 0.01


def test_one_batch_can_be_learnt() -> None:
    net = make_net(UNetConfig(widths=(8, 12), adapter_width=8)).train()
    guide = torch.rand(2, 8, 16, 16, generator=torch.Generator().manual_seed(1))
    coarse = torch.nn.functional.avg_pool2d(guide, 3, stride=1, padding=1)
    target = torch.cat([coarse[:, 1:], coarse[:, :1]], dim=1)
    optimizer = torch.optim.Adam(net.parameters(), lr=4e-3)
    losses = []
    for _ in range(150):
        loss = (net(guide) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
    assert losses[-1] < 0.1 * losses[0], f"loss went from {losses[0]:.4f} to {losses[-1]:.4f}"


def test_encoding_and_decoding_are_inverse() -> None:
    linear = torch.rand(2, 8, 5, 5)
    torch.testing.assert_close(
        decode_lightmap(encode_lightmap(linear, scale=SCALE), scale=SCALE), linear, rtol=1e-4, atol=1e-6
    )


def test_decoding_yields_a_physical_lightmap() -> None:
    lightmap = decode_lightmap(4.0 * torch.randn(1, 8, 6, 6), scale=SCALE)
    alpha = lightmap[:, LIGHTMAP_CHANNELS.index("alpha")]
    assert lightmap.min() >= 0.0 and alpha.max() <= 1.0


@pytest.mark.parametrize(
    ("channels", "scale", "rule"),
    [
        (("in_scatter", "opacity", "transmittance"), 1.0, "unknown"),
        (("in_scatter", "depth"), 1.0, "transmittance"),
        (("depth", "depth", "transmittance"), 1.0, "twice"),
        (PAPER, 0.0, "positive"),
        (PAPER, float("nan"), "finite"),
    ],
)
def test_a_guide_that_the_net_cannot_read_is_an_error(channels: tuple[str, ...], scale: float, rule: str) -> None:
    with pytest.raises(ValueError, match=rule):
        SixWayUNet(TINY, guide_channels=channels, guide_scale=scale)


def test_a_guide_of_other_channels_is_an_error() -> None:
    with pytest.raises(ValueError, match="3 channels"):
        make_net()(torch.zeros(1, 3, 16, 16))


@pytest.mark.parametrize("values", [{"widths": (8,)}, {"widths": (8, 0)}, {"adapter_blocks": -1}])
def test_config_bounds(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        UNetConfig.model_validate(values)
