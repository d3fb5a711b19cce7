"""VGG16 as far as relu3_3. The public weights are too large to ship: the layers are checked with others."""

import os
from pathlib import Path
from urllib.error import URLError

import pytest
import skimage.data
import torch
from torch import Tensor
from torch.nn import functional

from sixway.core.store import sha256_file
from sixway.losses.perceptual import FeatureExtractor
from sixway.models import vgg
from sixway.models.vgg import VGG16Features

SHAPES = {0: (64, 3), 2: (64, 64), 5: (128, 64), 7: (128, 128), 10: (256, 128), 12: (256, 256), 14: (256, 256)}
"""Numbers of the layers in torchvision's checkpoint, and their channels out and in."""


@pytest.fixture(scope="module")
def weights() -> dict[str, Tensor]:
    """A checkpoint of the right names and shapes, later layers included."""
    generator = torch.Generator().manual_seed(1)
    state: dict[str, Tensor] = {}
    for number, (wide, narrow) in {**SHAPES, 17: (8, 8)}.items():
        state[f"features.{number}.weight"] = torch.randn(wide, narrow, 3, 3, generator=generator) / (9 * narrow) ** 0.5
        state[f"features.{number}.bias"] = 0.1 * torch.randn(wide, generator=generator)
    state["classifier.0.weight"] = torch.zeros(3, 3)
    return state


def saved(weights: dict[str, Tensor], path: Path, monkeypatch: pytest.MonkeyPatch, *, new_format: bool = True) -> Path:
    """The checkpoint as a file whose hash is the pinned one."""
    torch.save(weights, path, _use_new_zipfile_serialization=new_format)
    monkeypatch.setattr(vgg, "SHA256", sha256_file(path))
    return path


def test_the_layers_against_their_formula(weights: dict[str, Tensor]) -> None:
    """In float64, convolution by convolution, as Simonyan & Zisserman's table D lists them."""
    picture = torch.rand(2, 3, 16, 20)
    mean, deviation = (torch.tensor(v).double().reshape(1, 3, 1, 1) for v in (vgg._MEAN, vgg._DEVIATION))
    values = (picture.double() - mean) / deviation
    expected = []
    for numbers in ((0, 2), (5, 7), (10, 12, 14)):
        if numbers[0]:
            values = values.unflatten(2, (-1, 2)).unflatten(4, (-1, 2)).amax(dim=(3, 5))
        for n in numbers:
            weight, bias = weights[f"features.{n}.weight"].double(), weights[f"features.{n}.bias"].double()
            values = functional.conv2d(values, weight, bias, padding=1).relu()
        expected.append(values)
    found = VGG16Features(weights)(picture)
    assert [tuple(f.shape[1:]) for f in found] == [(64, 16, 20), (128, 8, 10), (256, 4, 5)]
    for got, want in zip(found, expected, strict=True):
        assert want.std() > 0.05
        torch.testing.assert_close(got.double(), want, rtol=1e-4, atol=1e-5)


def test_it_is_frozen_and_differentiable(weights: dict[str, Tensor]) -> None:
    features = VGG16Features(weights)
    picture = torch.rand(1, 3, 8, 8, requires_grad=True)
    features(picture)[-1].sum().backward()
    assert picture.grad is not None and picture.grad.abs().max() > 0.0
    assert not any(w.requires_grad for w in features.parameters())
    assert isinstance(features, FeatureExtractor) and features.pretrained and features.name == "vgg16"


@pytest.mark.parametrize("new_format", [True, False], ids=["zip", "the format of 2017"])
def test_a_file_is_loaded(
    weights: dict[str, Tensor], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, new_format: bool
) -> None:
    path = saved(weights, tmp_path / "vgg.pth", monkeypatch, new_format=new_format)
    picture = torch.rand(1, 3, 8, 8)
    for got, want in zip(VGG16Features.load(path)(picture), VGG16Features(weights)(picture), strict=True):
        assert torch.equal(got, want)


def test_another_file_is_refused(weights: dict[str, Tensor], tmp_path: Path) -> None:
    torch.save(weights, tmp_path / "vgg.pth")
    with pytest.raises(ValueError, match="SHA-256"):
        VGG16Features.load(tmp_path / "vgg.pth")


def test_a_missing_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no such file of weights"):
        VGG16Features.load(tmp_path / "vgg.pth")


def test_weights_of_another_net_are_refused(weights: dict[str, Tensor]) -> None:
    with pytest.raises(ValueError, match=r"features\.14\.weight"):
        VGG16Features({name: values for name, values in weights.items() if name != "features.14.weight"})
    with pytest.raises(ValueError, match="size mismatch"):
        VGG16Features({**weights, "features.5.weight": torch.zeros(96, 64, 3, 3)})


def test_code_in_a_checkpoint_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Trap:
        def __reduce__(self) -> object:
            return (Path.touch, (tmp_path / "sprung",))

    path = saved({"features.0.weight": Trap()}, tmp_path / "vgg.pth", monkeypatch)  # type: ignore[dict-item]
    with pytest.raises(Exception, match="weights_only|Weights only"):
        VGG16Features.load(path)
    assert not (tmp_path / "sprung").exists()


def test_the_download_is_made_once(weights: dict[str, Tensor], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = saved(weights, tmp_path / "server.pth", monkeypatch)
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path / "hub"))
    monkeypatch.setattr(vgg, "URL", source.as_uri())
    VGG16Features.load()
    assert [p.name for p in (tmp_path / "hub" / "checkpoints").iterdir()] == ["server.pth"]
    source.unlink()
    VGG16Features.load()


def test_a_spoilt_download_is_not_kept(
    weights: dict[str, Tensor], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.save(weights, tmp_path / "server.pth")
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path / "hub"))
    monkeypatch.setattr(vgg, "URL", (tmp_path / "server.pth").as_uri())
    with pytest.raises(FileNotFoundError, match=r"invalid hash.*loss\.vgg_weights=PATH"):
        VGG16Features.load()
    assert not list((tmp_path / "hub" / "checkpoints").iterdir())


def test_without_a_network_the_remedies_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreachable(*_: object, **__: object) -> None:
        raise URLError("no route to host")

    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.setattr(torch.hub, "download_url_to_file", unreachable)
    with pytest.raises(FileNotFoundError, match=r"no route to host.*vgg_weights=PATH.*efficientnet_lite0"):
        VGG16Features.load()


def test_the_public_weights_have_their_place() -> None:
    path = os.environ.get("SIXWAY_VGG16_WEIGHTS")
    if not path:
        pytest.skip("SIXWAY_VGG16_WEIGHTS names no checkpoint of torchvision's VGG16")
    picture = torch.from_numpy(skimage.data.coffee()[:224, :224]).permute(2, 0, 1)[None].float() / 255.0
    alive = [(tap > 0.0).float().mean() for tap in VGG16Features.load(Path(path))(picture)]
    assert all(0.1 < share < 0.9 for share in alive)
