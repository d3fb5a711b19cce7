"""The block and the adapter of the channel pairs."""

import pytest
import torch

from sixway.models.adapter import ChannelAdapter
from sixway.models.nafblock import ChannelNorm, NAFBlock


def test_a_new_block_is_the_identity(device: str) -> None:
    features = torch.randn(2, 6, 9, 7, device=device)
    assert torch.equal(NAFBlock(6).to(device)(features), features)


def test_a_new_block_learns_through_beta_and_gamma() -> None:
    block = NAFBlock(6)
    block(torch.randn(2, 6, 9, 7)).square().mean().backward()
    for gate in (block.beta, block.gamma):
        assert gate.grad is not None and gate.grad.abs().max() > 0.0


def test_channel_norm_is_torch_layer_norm() -> None:
    norm = ChannelNorm(5)
    torch.nn.init.normal_(norm.weight)
    torch.nn.init.normal_(norm.bias)
    features = 3.0 + 2.0 * torch.randn(2, 5, 4, 6)
    expected = torch.nn.functional.layer_norm(
        features.permute(0, 2, 3, 1), (5,), norm.weight.flatten(), norm.bias.flatten(), eps=norm.epsilon
    ).permute(0, 3, 1, 2)
    torch.testing.assert_close(norm(features), expected, rtol=1e-4, atol=1e-5)


def test_channel_norm_has_finite_gradients_on_constant_pixels() -> None:
    features = torch.zeros(1, 4, 3, 3, requires_grad=True)
    ChannelNorm(4)(features).sum().backward()
    assert features.grad is not None and torch.isfinite(features.grad).all()


@pytest.mark.parametrize("blocks", [0, 1, 2])
def test_adapter_doubles_the_resolution(blocks: int) -> None:
    adapter = ChannelAdapter(10, width=8, blocks=blocks)
    assert adapter(torch.randn(2, 10, 5, 7)).shape == (2, 2, 10, 14)
