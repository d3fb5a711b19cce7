"""The net: shapes at any size, what a new net answers, gradients, precision, learning."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.models.adapter import ChannelAdapter
from sixway.models.conditioning import GuideConditioning
from sixway.models.cost import adapter_macs, gmac
from sixway.models.encoding import decode_lightmap, encode_lightmap
from sixway.models.unet import SixWayUNet, UNetConfig

SIX_LIGHTS = (*DIRECTIONS, "transmittance", "depth")
FIRE = (*SIX_LIGHTS, "emissive")
PAPER = ("in_scatter", "transmittance", "depth")
TINY = UNetConfig(widths=(4, 6, 8), adapter_width=4)
SCALE = 1.7
EMISSIVE_SCALE = 0.04


def make_net(config: UNetConfig = TINY, *, guide_channels: tuple[str, ...] = SIX_LIGHTS) -> SixWayUNet:
    torch.manual_seed(3)
    return SixWayUNet(config, guide_channels=guide_channels, guide_scale=SCALE, emissive_scale=EMISSIVE_SCALE).eval()


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
    channels=st.sampled_from([SIX_LIGHTS, FIRE, PAPER, ("depth", "front", "transmittance")]),
)
def test_any_size_keeps_its_size(height: int, width: int, batch: int, channels: tuple[str, ...]) -> None:
    guide = torch.rand(batch, len(channels), height, width)
    assert make_net(guide_channels=channels)(guide).shape == (batch, 8, height, width)


def test_one_head_for_all_channels_costs_what_the_adapters_do() -> None:
    config = UNetConfig(widths=(8, 12, 16), adapter_width=8)
    four, one = make_net(config), make_net(config.model_copy(update={"adapters": False}))
    assert (len(four.adapters), len(one.adapters)) == (4, 1)
    assert 0.95 < gmac(one, 64, 64) / gmac(four, 64, 64) <= 1.0
    assert one(smoky_guide(SIX_LIGHTS, 16, 16)).shape == (1, 8, 16, 16)


def test_the_cost_of_an_adapter_is_what_torch_counts() -> None:
    adapter = ChannelAdapter(10, 2, width=6, blocks=2)
    with FlopCounterMode(display=False) as counter:
        adapter(torch.zeros(1, 10, 8, 4), torch.zeros(1, 1, 8, 4))
    attention = 2 * 6 * 6  # once a picture
    assert counter.get_total_flops() / 2 == 8 * 4 * adapter_macs(10, 2, 6, 2) + attention


def test_the_net_of_the_main_run_is_small_enough_for_a_gpu() -> None:
    net = make_net(UNetConfig(widths=(32, 48, 96, 160, 256), adapter_width=24), guide_channels=FIRE)
    assert 9.0 < gmac(net, 512, 512) <= 10.0
    assert gmac(net, 256, 256) == pytest.approx(gmac(net, 512, 512) / 4, rel=1e-3)


def test_an_odd_size_with_the_default_net(device: str) -> None:
    net = make_net(UNetConfig()).to(device)
    lightmap = net(smoky_guide(SIX_LIGHTS, 130, 97).to(device))
    assert lightmap.shape == (1, 8, 130, 97) and torch.isfinite(lightmap).all()


def uncorrected(net: SixWayUNet) -> SixWayUNet:
    for adapter in net.adapters:
        torch.nn.init.zeros_(adapter.head.weight)  # type: ignore[union-attr, arg-type]
    return net


def test_without_correction_the_answer_is_the_guide() -> None:
    guide = smoky_guide(FIRE, 20, 24)
    guide[:, FIRE.index("emissive")] *= 50.0
    lightmap = uncorrected(make_net(guide_channels=FIRE))(guide)
    for channel in (*DIRECTIONS, "emissive"):
        scale = EMISSIVE_SCALE if channel == "emissive" else SCALE
        expected = encode_srgb(scale * guide[:, FIRE.index(channel)])
        torch.testing.assert_close(lightmap[:, LIGHTMAP_CHANNELS.index(channel)], expected)
    torch.testing.assert_close(
        lightmap[:, LIGHTMAP_CHANNELS.index("alpha")], 1.0 - guide[:, FIRE.index("transmittance")]
    )


def test_what_the_guide_does_not_show_comes_from_the_net_alone() -> None:
    lightmap = uncorrected(make_net(guide_channels=PAPER))(smoky_guide(PAPER, 16, 16))
    shown = LIGHTMAP_CHANNELS.index("alpha")
    assert lightmap[:, shown].abs().max() > 0.0
    assert lightmap[:, [i for i in range(8) if i != shown]].abs().max() == 0.0


@pytest.mark.parametrize("channel", LIGHTMAP_CHANNELS)
def test_every_channel_has_its_adapter(channel: str) -> None:
    """A bias on one adapter's head moves the named channel and no other."""
    pairs = [("right", "left"), ("top", "bottom"), ("front", "back"), ("alpha", "emissive")]
    number, place = next((i, pair.index(channel)) for i, pair in enumerate(pairs) if channel in pair)
    net, guide = make_net(), smoky_guide(SIX_LIGHTS, 16, 16)
    before = net(guide)
    net.adapters[number].head.bias.data[4 * place : 4 * place + 4] += 1.0  # type: ignore[union-attr, index, operator]
    moved = (net(guide) - before).mean(dim=(0, 2, 3))
    expected = torch.tensor([float(name == channel) for name in LIGHTMAP_CHANNELS])
    torch.testing.assert_close(moved, expected)


def test_a_new_net_leaves_empty_space_empty() -> None:
    assert make_net()(empty_guide(SIX_LIGHTS, 13, 19)).abs().max() < 1e-6


def disc(channels: tuple[str, ...], size: int) -> Tensor:
    """A round cloud that leaves an eighth of the picture empty on every side."""
    across = (torch.arange(size) - 0.5 * (size - 1)) / (0.375 * size)
    inside = (across[:, None].square() + across[None, :].square() < 1.0).float()
    noise = torch.rand(1, len(channels), size, size, generator=torch.Generator().manual_seed(2))
    guide = noise * inside
    guide[:, channels.index("transmittance")] = 1.0 - guide[:, channels.index("transmittance")]
    return guide


def framed(guide: Tensor, border: int) -> Tensor:
    """The guide amid so many px of empty space."""
    size = guide.shape[-1] + 2 * border
    wide = empty_guide(SIX_LIGHTS, size, size)
    wide[:, :, border:-border, border:-border] = guide
    return wide


def trained_a_little(net: SixWayUNet, guide: Tensor) -> SixWayUNet:
    """Fitted to light that is twice what the guide shows, blurred: every part of the net has moved."""
    target = torch.nn.functional.avg_pool2d(2.0 * net.conditioning(guide), 5, stride=1, padding=2)
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-2)
    for _ in range(60):
        loss = (net(guide) - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return net


@pytest.mark.parametrize("state", ["attentive", "trained"])
def test_an_empty_border_changes_no_map(state: str) -> None:
    """25 to 100 % more picture on every side; within 4 px of its edge the adapters' kernels reach out of it."""
    net, guide = make_net(UNetConfig(widths=(6, 8, 10), adapter_width=6)), disc(SIX_LIGHTS, 32)
    if state == "trained":
        trained_a_little(net, guide)
    else:  # the attention at full strength, from which a mean over the whole picture changes the maps by 0.3
        for name, parameter in net.adapters.named_parameters():
            if name.endswith(("beta", "gamma", "attention.weight")):
                torch.nn.init.normal_(parameter)
    with torch.no_grad():
        alone = net(guide)
        assert (alone - make_net()._shown(net.conditioning(guide))).abs().max() > 0.1
        for border in (8, 16, 32):
            within = net(framed(guide, border))[:, :, border:-border, border:-border]
            torch.testing.assert_close(within[..., 4:-4, 4:-4], alone[..., 4:-4, 4:-4], rtol=0.0, atol=2e-4)


def test_padding_is_an_empty_border() -> None:
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


def test_the_scales_travel_with_the_state() -> None:
    other = SixWayUNet(TINY, guide_channels=SIX_LIGHTS, guide_scale=1.0)
    assert float(other.conditioning.emissive_scale) == 1.0
    other.load_state_dict(make_net().state_dict())
    assert float(other.conditioning.scale) == pytest.approx(SCALE)
    assert float(other.conditioning.emissive_scale) == pytest.approx(EMISSIVE_SCALE)


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


@pytest.mark.parametrize("emissive_scale", [None, EMISSIVE_SCALE])
def test_encoding_and_decoding_are_inverse(emissive_scale: float | None) -> None:
    linear = torch.rand(2, 8, 5, 5)
    encoded = encode_lightmap(linear, scale=SCALE, emissive_scale=emissive_scale)
    torch.testing.assert_close(
        decode_lightmap(encoded, scale=SCALE, emissive_scale=emissive_scale), linear, rtol=1e-4, atol=1e-6
    )


def test_fire_has_a_scale_of_its_own() -> None:
    linear = torch.zeros(1, 8, 1, 1)
    linear[:, 0], linear[:, LIGHTMAP_CHANNELS.index("emissive")] = 1.0 / SCALE, 1.0 / EMISSIVE_SCALE
    expected = torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]).reshape(1, 8, 1, 1)
    torch.testing.assert_close(encode_lightmap(linear, scale=SCALE, emissive_scale=EMISSIVE_SCALE), expected)


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


def test_a_scale_of_fire_that_is_not_positive_is_an_error() -> None:
    with pytest.raises(ValueError, match="emissive_scale 0.0 .*positive"):
        SixWayUNet(TINY, guide_channels=FIRE, guide_scale=1.0, emissive_scale=0.0)


def test_a_guide_of_other_channels_is_an_error() -> None:
    with pytest.raises(ValueError, match="3 channels"):
        make_net()(torch.zeros(1, 3, 16, 16))


@pytest.mark.parametrize("values", [{"widths": (8,)}, {"widths": (8, 0)}, {"adapter_blocks": -1}])
def test_config_bounds(values: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        UNetConfig.model_validate(values)
