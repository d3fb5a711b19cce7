"""FlowNet: its parts against closed forms, and the shipped weights on translations that are known."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from sixway.core.store import read_json, write_json
from sixway.models.flow_warp import resized_flow, warp
from sixway.models.flownet import CARD, SHIPPED, WEIGHTS, FlowNet, FlowNetConfig, cost_volume, load_flownet

SMALL = FlowNetConfig(features=(4, 6), decoders=(8, 8), reaches_px=(1, 2))


def test_the_cost_volume_peaks_at_the_shift() -> None:
    one = torch.randn(1, 12, 9, 11, generator=torch.Generator().manual_seed(1))
    two = torch.roll(one, shifts=(1, -2), dims=(2, 3))  # what is at (y, x) is found at (y + 1, x - 2)
    costs = cost_volume(one, two, reach_px=2)
    assert costs.shape == (1, 25, 9, 11)
    inside = costs[0, :, 2:-2, 2:-2]
    shift = inside.argmax(dim=0)
    assert (shift == (1 + 2) * 5 + (-2 + 2)).all()
    torch.testing.assert_close(inside.max(dim=0).values, torch.ones_like(inside[0]))


def test_a_resized_flow_moves_as_far() -> None:
    flow = torch.tensor([1.0, -2.0]).reshape(1, 2, 1, 1).expand(1, 2, 4, 6)
    twice = resized_flow(flow, height=8, width=18)
    torch.testing.assert_close(twice, torch.tensor([3.0, -4.0]).reshape(1, 2, 1, 1).expand(1, 2, 8, 18))


@pytest.mark.parametrize("size", [(16, 16), (33, 50)])
def test_any_size_and_every_level(size: tuple[int, int]) -> None:
    torch.manual_seed(0)
    net = FlowNet(SMALL)
    flows = net.pyramid(torch.rand(2, 1, *size), torch.rand(2, 1, *size))
    assert [tuple(flow.shape) for flow in flows] == [(2, 2, *size)] * 2
    assert all(torch.isfinite(flow).all() for flow in flows)


def test_pairs_do_not_see_one_another() -> None:
    torch.manual_seed(0)
    net = FlowNet(SMALL)
    first, second = torch.rand(3, 1, 24, 24), torch.rand(3, 1, 24, 24)
    alone = net(first[1:2], second[1:2])
    torch.testing.assert_close(net(first, second)[1:2], alone, rtol=1e-4, atol=1e-7)


def test_brightness_does_not_matter(puffs: Callable[..., Tensor]) -> None:
    torch.manual_seed(0)
    net = FlowNet(SMALL)
    first, second = puffs(), puffs(right=1.0)
    torch.testing.assert_close(net(0.2 * first, 0.2 * second), net(first, second), rtol=1e-2, atol=1e-5)


def test_levels_are_counted_once() -> None:
    with pytest.raises(ValueError, match="levels"):
        FlowNet(FlowNetConfig(features=(4, 6), decoders=(8, 8), reaches_px=(1, 2, 2)))


def test_the_shipped_net_is_frozen_small_and_differentiable(device: str, puffs: Callable[..., Tensor]) -> None:
    net = load_flownet().to(device)
    assert net.name == "flownet" and net.pretrained and not net.training
    assert sum(parameter.numel() for parameter in net.parameters()) <= 1_500_000
    assert not any(parameter.requires_grad for parameter in net.parameters())
    second = puffs(right=1.0).to(device).requires_grad_()
    net(puffs().to(device), second)[:, 0].mean().backward()
    assert second.grad is not None and torch.isfinite(second.grad).all() and second.grad.abs().max() > 0.0


@pytest.mark.parametrize("motion", [(1.0, 0.0), (0.5, -1.5), (-2.8, 2.8), (4.0, 0.0), (0.0, -6.0)])
def test_the_shipped_net_sees_a_known_translation(
    motion: tuple[float, float], device: str, puffs: Callable[..., Tensor]
) -> None:
    first, second = puffs().to(device), puffs(right=motion[0], down=motion[1]).to(device)
    flow = load_flownet().to(device)(first, second)
    endpoint_error = (flow - flow.new_tensor(motion).reshape(1, 2, 1, 1)).norm(dim=1, keepdim=True)
    assert endpoint_error[first > 0.05].mean() < 0.5
    assert (warp(second, flow) - first).abs().mean() < 0.3 * (second - first).abs().mean()


def test_black_pictures_are_finite() -> None:
    first, second = torch.zeros(1, 1, 33, 20, requires_grad=True), torch.zeros(1, 1, 33, 20, requires_grad=True)
    flow = load_flownet()(first, second)
    flow.abs().sum().backward()
    for tensor in (flow, first.grad, second.grad):
        assert tensor is not None and torch.isfinite(tensor).all()


def test_weights_and_card_belong_together(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="train_flow"):
        load_flownet(tmp_path)
    for name in (WEIGHTS, CARD):
        shutil.copy(SHIPPED / name, tmp_path / name)
    load_flownet(tmp_path)
    card = read_json(tmp_path / CARD)
    write_json(tmp_path / CARD, card | {"weights_sha256": "0" * 64})
    with pytest.raises(ValueError, match="copy both from one run"):
        load_flownet(tmp_path)
    write_json(tmp_path / CARD, {"format": 2})
    with pytest.raises(ValueError, match="no card"):
        load_flownet(tmp_path)


def test_the_shipped_files_are_small() -> None:
    assert (SHIPPED / WEIGHTS).stat().st_size <= 6_000_000
