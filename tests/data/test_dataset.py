"""The dataset as training reads it: what a batch holds, and what damaged folders get."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST, read_manifest


@pytest.fixture
def own_copy(tiny_dataset: Any, tmp_path: Path) -> Path:
    """What training reads of the tiny dataset, to be damaged."""
    shutil.copytree(tiny_dataset.folder / "packed", tmp_path / "data" / "packed")
    shutil.copy(tiny_dataset.folder / MANIFEST, tmp_path / "data" / MANIFEST)
    return tmp_path / "data"


def edit(folder: Path, change: Any) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    change(manifest)
    (folder / MANIFEST).write_text(json.dumps(manifest))


def test_pairs_are_consecutive_frames_of_one_view(tiny_dataset: Any) -> None:
    for split in ("train", "val", "test"):
        dataset = SmokeDataset(tiny_dataset.folder, guide="six", split=split)
        assert len(dataset) == 2 * 2 * 2  # views x pairs x frames of a pair
        samples = dataset.groups[0].samples
        for first, second in zip(samples[::2], samples[1::2], strict=True):
            assert (first.simulation, first.view) == (second.simulation, second.view)
            assert second.frame == first.frame + 1
        assert len({(s.view, s.frame) for s in samples}) == len(samples)


def test_splits_share_no_simulation(tiny_dataset: Any) -> None:
    groups = read_manifest(tiny_dataset.folder).groups
    seen = {split: {s.simulation for g in groups if g.split == split for s in g.samples} for split in ("train", "test")}
    assert seen == {"train": {"jet"}, "test": {"jet_test"}}


def test_a_pair_holds_the_pixels_of_its_frames_on_disk(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="train")
    for row in range(len(dataset) // 2):
        pair = dataset.pair(0, row)
        assert pair.guide.dtype == pair.target.dtype == torch.float32
        for i, sample in enumerate(dataset.groups[0].samples[2 * row : 2 * row + 2]):
            image = read_exr(tiny_dataset.folder / sample.target, LIGHTMAP_CHANNELS[:-1], (20, 24))
            np.testing.assert_array_equal(np.moveaxis(pair.target[i, :7].numpy(), 0, -1), image)


def test_a_dataset_without_fire_has_a_zero_emissive_channel(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="paper", split="train")
    assert not dataset.has_emissive
    batch = dataset.batch(np.random.default_rng(0), num_pairs=3, flip=True)
    assert batch.target.shape == (6, 8, 20, 24)
    assert (batch.target[:, LIGHTMAP_CHANNELS.index("emissive")] == 0.0).all()
    assert (batch.target[:, :7].amax((0, 2, 3)) > 0.0).all()


def test_a_batch_is_a_function_of_its_random_numbers_alone(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="train")

    def draw(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
        batch = dataset.batch(np.random.default_rng(seed), num_pairs=4, flip=True)
        return batch.guide, batch.target

    first = draw(1)
    other = draw(2)
    again = draw(1)
    assert torch.equal(first[0], again[0]) and torch.equal(first[1], again[1])
    assert not torch.equal(first[0], other[0])


def test_flips_reach_every_orientation_and_both_frames_of_a_pair_alike(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="train")
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    known = {}
    for row in range(len(dataset) // 2):
        pair = dataset.pair(0, row).target[:, alpha]
        for name, axes in {"as is": (), "h": (-1,), "v": (-2,), "hv": (-2, -1)}.items():
            known[pair.flip(axes).numpy().tobytes()] = name
    rng = np.random.default_rng(0)
    batch = dataset.batch(rng, num_pairs=40, flip=True).target[:, alpha]
    assert {known[pair.numpy().tobytes()] for pair in batch.unflatten(0, (-1, 2))} == {"as is", "h", "v", "hv"}
    unflipped = dataset.batch(rng, num_pairs=10, flip=False).target[:, alpha]
    assert {known[pair.numpy().tobytes()] for pair in unflipped.unflatten(0, (-1, 2))} == {"as is"}


def test_a_larger_size_takes_fewer_pairs_and_every_picture_is_seen_equally_often(mixed_dataset: Path) -> None:
    dataset = SmokeDataset(mixed_dataset, guide="six", split="train")
    assert [len(group.samples) for group in dataset.groups] == [8, 2]
    rng = np.random.default_rng(0)
    seen = {(20, 24): 0, (40, 48): 0}
    for _ in range(600):
        batch = dataset.batch(rng, num_pairs=4, flip=False)
        size = tuple(batch.guide.shape[2:])
        assert len(batch.guide) == len(batch.target) == {(20, 24): 8, (40, 48): 2}[size]  # four times the pixels
        seen[size] += len(batch.guide)
    assert seen[(40, 48)] / seen[(20, 24)] == pytest.approx(2 / 8, rel=0.15)


def test_sizes_may_have_equal_shares_instead(mixed_dataset: Path) -> None:
    dataset = SmokeDataset(mixed_dataset, guide="six", split="train")
    rng = np.random.default_rng(0)
    wide = [dataset.batch(rng, num_pairs=1, flip=False, draw="sizes").guide.shape[3] == 48 for _ in range(300)]
    assert 0.4 < np.mean(wide) < 0.6


def test_a_batch_carries_the_flow_of_its_own_pairs(tiny_dataset: Any) -> None:
    dataset = SmokeDataset(tiny_dataset.folder, guide="six", split="train")
    assert dataset.batch(np.random.default_rng(0), num_pairs=2, flip=True).flow is None
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    pairs = [dataset.pair(0, row).target[:, alpha].numpy() for row in range(len(dataset) // 2)]
    dataset.pair_flows = [np.stack(pairs).astype(np.float16)]  # told apart by what they show
    batch = dataset.batch(np.random.default_rng(0), num_pairs=6, flip=False)
    assert batch.flow is not None and batch.flow.dtype == torch.float32
    assert torch.equal(batch.flow, batch.target[:, alpha].unflatten(0, (-1, 2)).half().float())


def test_flips_of_a_summed_guide_with_lopsided_lights_are_refused(own_copy: Path) -> None:
    edit(own_copy, lambda manifest: manifest["guides"]["paper"].update(lights=["front", "right"]))
    dataset = SmokeDataset(own_copy, guide="paper", split="train")
    with pytest.raises(ValueError, match=r"left.*switch flips off"):
        dataset.batch(np.random.default_rng(0), num_pairs=1, flip=True)
    dataset.batch(np.random.default_rng(0), num_pairs=1, flip=False)


def test_an_unknown_guide_lists_those_there_are(tiny_dataset: Any) -> None:
    with pytest.raises(ValueError, match=r"no guide variant 'sixx'; this dataset has: paper, six"):
        SmokeDataset(tiny_dataset.folder, guide="sixx", split="train")


def test_a_flipped_byte_is_noticed(own_copy: Path) -> None:
    path = next((own_copy / "packed").glob("train_*_target_*.npy"))
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{path.name}: its hash differs.*run the generation command again"):
        SmokeDataset(own_copy, guide="six", split="train")
    SmokeDataset(own_copy, guide="six", split="val")


def test_a_missing_array_is_named(own_copy: Path) -> None:
    path = next((own_copy / "packed").glob("train_*_guide_six_*.npy"))
    path.unlink()
    with pytest.raises(FileNotFoundError, match=rf"{path.name}.*missing; run the generation command again"):
        SmokeDataset(own_copy, guide="six", split="train")


def test_an_array_of_another_shape_than_the_manifest_says(own_copy: Path) -> None:
    edit(own_copy, lambda manifest: manifest["groups"][0].update(width_px=23))
    with pytest.raises(ValueError, match=r"expected float16 \(8, \d+, 20, 23\)"):
        SmokeDataset(own_copy, guide="six", split="train")


def test_no_manifest_names_the_command_that_makes_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no finished dataset here; run: python data_gen/generate\.py"):
        read_manifest(tmp_path)


def test_a_split_without_samples_says_what_to_do(own_copy: Path) -> None:
    edit(own_copy, lambda m: m.update(groups=[g for g in m["groups"] if g["split"] != "val"]))
    with pytest.raises(ValueError, match="has no val samples; give a simulation that split"):
        SmokeDataset(own_copy, guide="six", split="val")


@pytest.mark.parametrize("junk", [b"", b"{", b"\xff\xfe\x00", b"[]", b"{}", b'"six"', b"null"])
def test_a_junk_manifest_is_named(tmp_path: Path, junk: bytes) -> None:
    (tmp_path / MANIFEST).write_bytes(junk)
    with pytest.raises(ValueError, match=rf"{MANIFEST}: .*; (restore|generate)"):
        read_manifest(tmp_path)


def test_a_manifest_of_another_format_asks_for_a_new_one(own_copy: Path) -> None:
    edit(own_copy, lambda manifest: manifest.update(format=2))
    with pytest.raises(ValueError, match=rf"{MANIFEST}: format: .*generate the dataset with this version again"):
        read_manifest(own_copy)


@pytest.mark.parametrize("scale", [0.0, -1.0, "bright"])
def test_an_impossible_scale_is_refused(own_copy: Path, scale: object) -> None:
    edit(own_copy, lambda manifest: manifest.update(scale=scale))
    with pytest.raises(ValueError, match=rf"{MANIFEST}: scale: "):
        read_manifest(own_copy)


@pytest.mark.parametrize("outside", ["../secret.npy", "packed/../../secret.npy", "/etc/passwd"])
def test_a_manifest_cannot_reach_outside_its_folder(own_copy: Path, outside: str) -> None:
    target = next((own_copy / "packed").glob("train_*_target_*.npy"))
    shutil.copy(target, own_copy.parent / "secret.npy")
    edit(own_copy, lambda manifest: manifest["groups"][0]["arrays"]["target"].update(path=outside))
    with pytest.raises(ValueError, match="points outside"):
        SmokeDataset(own_copy, guide="six", split="train")
