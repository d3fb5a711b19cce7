"""The floors are what they are called: a mean, a least-squares fit, and the guide itself."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sixway.baselines.encoding import encode_target
from sixway.baselines.floors import CoarseMaps, LinearFit, MeanImage, floors
from sixway.core.color import decode_srgb, encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.store import sha256_file
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST


def everything(dataset: SmokeDataset) -> tuple[np.ndarray, np.ndarray]:
    """Raw guides and encoded targets of all frames."""
    pairs = [dataset.pair(0, row) for row in range(len(dataset) // 2)]
    return np.concatenate([p.guide.numpy() for p in pairs]), np.concatenate([encode_target(dataset, p) for p in pairs])


@pytest.fixture(scope="module")
def six(tiny_dataset: Any) -> SmokeDataset:
    return SmokeDataset(tiny_dataset.folder, guide="six", split="train")


def test_the_mean_image_is_the_mean(six: SmokeDataset) -> None:
    maps = np.array(six._targets[0], np.float64)
    expected = encode_srgb(maps[:, :6] * six.manifest.scale).mean(0)
    guides, targets = everything(six)
    answer = MeanImage(six).answer(guides, ())
    assert answer.shape == targets.shape and answer.dtype == np.float32
    for shown in answer:
        np.testing.assert_allclose(shown[:6], expected, atol=1e-5)
        np.testing.assert_allclose(shown[6], maps[:, 6].mean(0), atol=1e-5)
        np.testing.assert_allclose(shown[7], 0.0, atol=1e-6)


def test_the_mean_image_of_another_size_is_resampled(six: SmokeDataset) -> None:
    """Twice the size: the mean over each 2 x 2 block is close to the pixel that it came from."""
    small = MeanImage(six).answer(np.zeros((1, 8, 20, 24), np.float32), ())
    large = MeanImage(six).answer(np.zeros((1, 8, 40, 48), np.float32), ())
    assert large.shape == (1, 8, 40, 48)
    blocks = large.reshape(1, 8, 20, 2, 24, 2).mean(axis=(3, 5))
    np.testing.assert_allclose(blocks.mean((2, 3)), small.mean((2, 3)), rtol=0.02, atol=1e-4)
    assert np.corrcoef(blocks[0, :7].ravel(), small[0, :7].ravel())[0, 1] > 0.99


def test_a_linear_relation_is_recovered(tiny_dataset: Any, tmp_path: Path, rng: np.random.Generator) -> None:
    """Targets made by a known mix of the conditioned guide; held-out guides get the same mix."""
    folder = tmp_path / "data"
    shutil.copytree(tiny_dataset.folder / "packed", folder / "packed")
    manifest = json.loads((tiny_dataset.folder / MANIFEST).read_text())
    arrays = manifest["groups"][0]["arrays"]
    guide = np.load(tiny_dataset.folder / arrays["guide_paper"]["path"]).astype(np.float64)
    mix = rng.uniform(0.05, 0.3, (7, 4))  # rows: maps; columns: in_scatter, alpha, depth, constant

    def mixed(raw: np.ndarray) -> np.ndarray:
        x = [encode_srgb(raw[:, 0] * manifest["scale"]), 1.0 - raw[:, 1], raw[:, 2], np.ones_like(raw[:, 0])]
        return np.einsum("mk,knhw->nmhw", mix, np.array(x))

    encoded = mixed(guide)
    linear = np.concatenate([decode_srgb(encoded[:, :6]) / manifest["scale"], encoded[:, 6:]], axis=1)
    path = folder / arrays["target"]["path"]
    np.save(path, linear.astype(np.float16))
    arrays["target"]["sha256"] = sha256_file(path)
    (folder / MANIFEST).write_text(json.dumps(manifest))

    fit = LinearFit(SmokeDataset(folder, guide="paper", split="train"))
    unseen, _ = everything(SmokeDataset(folder, guide="paper", split="test"))
    answer = fit.answer(unseen, ())
    np.testing.assert_allclose(answer[:, :7], mixed(unseen.astype(np.float64)), atol=2e-3)  # targets are half floats
    np.testing.assert_allclose(answer[:, 7], 0.0, atol=1e-6)


@pytest.mark.parametrize("guide", ["six", "paper"])
def test_the_linear_fit_is_the_best_of_its_kind(tiny_dataset: Any, guide: str) -> None:
    """On its own training frames nothing linear beats it: no constant, no single channel, no nudged weights."""
    dataset = SmokeDataset(tiny_dataset.folder, guide=guide, split="train")
    guides, targets = everything(dataset)
    fit = LinearFit(dataset)

    def error(answer: np.ndarray) -> np.ndarray:
        return ((answer - targets) ** 2).mean((0, 2, 3))[:7]

    best = error(fit.answer(guides, ()))
    assert (best <= targets.var((0, 2, 3))[:7] + 1e-7).all()
    if guide == "six":
        assert (best <= error(CoarseMaps(dataset).answer(guides, ())) + 1e-7).all()
    for change in (0.97, 1.03):
        other = LinearFit(dataset)
        other._weights = fit._weights * change
        assert (best < error(other.answer(guides, ()))).all()


def test_answers_are_never_negative(six: SmokeDataset) -> None:
    fit = LinearFit(six)
    fit._weights = fit._weights - 0.5
    assert fit.answer(everything(six)[0], ()).min() == 0.0


def test_the_coarse_maps_are_the_guide(six: SmokeDataset) -> None:
    guides, _ = everything(six)
    answer = CoarseMaps(six).answer(guides, ())
    for i, name in enumerate(LIGHTMAP_CHANNELS[:6]):
        raw = guides[:, six.guide_channels.index(name)].astype(np.float64)
        np.testing.assert_allclose(answer[:, i], encode_srgb(raw * six.manifest.scale), atol=1e-5, err_msg=name)
    transmittance = guides[:, six.guide_channels.index("transmittance")]
    np.testing.assert_allclose(answer[:, LIGHTMAP_CHANNELS.index("alpha")], 1.0 - transmittance, atol=1e-6)
    assert (answer[:, LIGHTMAP_CHANNELS.index("emissive")] == 0.0).all()


def test_a_guide_without_six_maps_has_no_coarse_maps(tiny_dataset: Any, six: SmokeDataset) -> None:
    paper = SmokeDataset(tiny_dataset.folder, guide="paper", split="train")
    with pytest.raises(ValueError, match="shows no map of every direction"):
        CoarseMaps(paper)
    test = SmokeDataset(tiny_dataset.folder, guide="six", split="test")
    card = "billboard baked at yaw 0"
    assert [floor.name for floor in floors(paper, test)] == ["mean image", "linear fit", card]
    assert [floor.name for floor in floors(six, test)] == ["mean image", "linear fit", "guide as it is", card]
    assert set(DIRECTIONS) <= set(six.guide_channels)
