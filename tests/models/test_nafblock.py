"""The block and the adapter of the channel pairs."""

import pytest
import torch

from sixway.models.adapter import ChannelAdapter
from sixway.models.nafblock import ChannelNorm, NAFBlock, share_of_smoke


def test_a_new_block_is_the_identity(device: str) -> None:
    features = torch.randn(2, 6, 9, 7, device=device)
    smoke = torch.rand(2, 1, 9, 7, device=device)
    assert torch.equal(NAFBlock(6).to(device)(features, smoke), features)


def test_a_new_block_learns_through_beta_and_gamma() -> None:
    block = NAFBlock(6)
    block(torch.randn(2, 6, 9, 7), torch.ones(2, 1, 9, 7)).square().mean().backward()
    for gate in (block.beta, block.gamma):
        assert gate.grad is not None and gate.grad.abs().max() > 0.0


def test_channel_norm_is_its_formula_when_traced() -> None:
    features = 3.0 + 2.0 * torch.randn(2, 5, 4, 6)
    centred = features - features.mean(dim=1, keepdim=True)
    expected = centred / centred.square().mean(dim=1, keepdim=True).sqrt()
    norm = ChannelNorm()
    torch.testing.assert_close(norm(features), expected, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(torch.jit.trace(norm, features)(features), expected, rtol=1e-4, atol=1e-5)


def test_channel_norm_has_finite_gradients_on_constant_pixels() -> None:
    features = torch.zeros(1, 4, 3, 3, requires_grad=True)
    ChannelNorm()(features).sum().backward()
    assert features.grad is not None and torch.isfinite(features.grad).all()


@pytest.mark.parametrize("blocks", [0, 1, 2])
def test_adapter_doubles_the_resolution(blocks: int) -> None:
    adapter = ChannelAdapter(10, 3, width=8, blocks=blocks)
    assert adapter(torch.randn(2, 10, 5, 7), torch.ones(2, 1, 5, 7)).shape == (2, 3, 10, 14)


def test_weights_of_smoke_make_a_mean_over_the_smoke() -> None:
    alpha, values = torch.rand(2, 1, 8, 6), torch.randn(2, 5, 4, 3)
    alpha[:, :, :4] = 0.0
    pooled = alpha.reshape(2, 4, 2, 3, 2).mean(dim=(2, 4))[:, None]
    expected = (values * pooled).sum(dim=(2, 3)) / pooled.sum(dim=(2, 3))
    torch.testing.assert_close((values * share_of_smoke(alpha)).mean(dim=(2, 3)), expected, rtol=1e-4, atol=1e-5)


def test_weights_without_smoke_are_zero() -> None:
    assert share_of_smoke(torch.zeros(1, 1, 4, 4)).abs().max() == 0.0


def test_the_block_does_not_see_an_empty_border() -> None:
    """But for one pixel at the edge of the picture, where the depthwise convolution reaches out of it."""
    torch.manual_seed(1)
    block = NAFBlock(6)
    for gate in (block.beta, block.gamma):
        torch.nn.init.normal_(gate)
    features, alpha = torch.randn(1, 6, 8, 6), torch.zeros(1, 1, 16, 12)
    alpha[..., 2:-2, 2:-2] = torch.rand(12, 8)
    bordered, bordered_alpha = torch.randn(1, 6, 16, 22), torch.zeros(1, 1, 32, 44)
    bordered[..., 4:12, 2:8] = features
    bordered_alpha[..., 8:24, 4:16] = alpha
    alone = block(features, share_of_smoke(alpha))
    within = block(bordered, share_of_smoke(bordered_alpha))[..., 4:12, 2:8]
    torch.testing.assert_close(within[..., 1:-1, 1:-1], alone[..., 1:-1, 1:-1], rtol=0.0, atol=1e-4)
