"""Packing and verifying: the arrays are the frames, and every damage is found and told."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sixway.core.color import encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr, read_exr_attributes, write_exr
from sixway.core.store import read_json, read_json_lines, sha256_file
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import MANIFEST, read_manifest
from sixway.generation.jobs import INDEX
from sixway.generation.plan import Plan
from sixway.generation.stages import FLOW_CHANNELS, TARGET_CHANNELS, Generation
from sixway.reference.lightmaps import LightmapTracer
from sixway.volumes.npz import read_npz, write_npz

Generate = Callable[..., int]
Contents = Callable[[Path], dict[str, str]]


def test_the_scale_puts_the_training_maps_at_one(tiny_dataset: Any) -> None:
    manifest = read_manifest(tiny_dataset.folder)
    maps = np.load(tiny_dataset.folder / manifest.split("train")[0].arrays["target"].path)[:, :6].astype(np.float64)
    assert np.percentile(maps, 99.9) * manifest.scale == pytest.approx(1.0, rel=0.01)


def test_every_layer_is_packed_as_it_stands_on_disk(tiny_dataset: Any) -> None:
    folder = tiny_dataset.folder
    manifest = read_manifest(folder)
    for group in manifest.groups:
        for layer, array in group.arrays.items():
            values = np.load(folder / array.path)
            for row, sample in enumerate(group.samples):
                (path,) = folder.glob(f"{layer}/{sample.simulation}/{sample.view}/*/frame_{sample.frame:04d}.exr")
                np.testing.assert_array_equal(np.moveaxis(values[row], 0, -1), read_exr(path, array.channels))
        if group.split == "train":  # evaluation alone reads motion
            assert "flow" not in group.arrays
        else:
            assert group.arrays["flow"].channels == FLOW_CHANNELS


def test_references_that_are_scored_take_more_samples(tiny_dataset: Any) -> None:
    for name, samples in {"jet": 1, "jet_val": 4, "jet_test": 4}.items():
        described = list(tiny_dataset.folder.glob(f"target/{name}/*/*/made_by.json"))
        assert len(described) == 2
        assert all(read_json(path)["reference"]["samples"] == samples for path in described)


def test_test_references_are_less_noisy_than_one_sample_would_be(tiny_dataset: Any) -> None:
    plan = Plan.read(tiny_dataset.config)
    job = Generation(plan=plan, out=tiny_dataset.folder)
    simulation = next(s for s in plan.simulations if s.split == "test")
    view, frame = simulation.views[0], simulation.frames[-1]

    def trace(samples: int, seed: int) -> np.ndarray:
        config = plan.config.reference.model_copy(update={"samples": samples})
        tracer = LightmapTracer(config, plan.config.medium.medium, device="cpu")
        return tracer.trace(job.read_density(simulation, frame), view.camera, seed=seed).image

    truth = trace(256, 1)
    on_disk = read_exr(job.store(plan.target(simulation, view)).frame_path(frame, ".exr"), TARGET_CHANNELS)
    seed = plan.frame_seed(simulation, frame)
    np.testing.assert_array_equal(on_disk, (0.5 * (trace(2, seed) + trace(2, seed ^ 0x5EED))).astype(np.float16))
    assert np.mean((on_disk - truth) ** 2) < 0.5 * np.mean((trace(1, 2) - truth) ** 2)


def test_the_noise_of_the_references_is_measured(tiny_dataset: Any) -> None:
    manifest = read_manifest(tiny_dataset.folder)
    assert manifest.noise_psnr_db is not None
    maps = np.load(tiny_dataset.folder / manifest.split("test")[0].arrays["target"].path)[:, :6].astype(np.float64)
    spread = float(np.mean(encode_srgb(maps * manifest.scale) ** 2))
    assert 15.0 < manifest.noise_psnr_db < 80.0
    assert 10.0 ** (-manifest.noise_psnr_db / 10.0) < 0.1 * spread


def test_a_frame_says_where_it_came_from(tiny_dataset: Any) -> None:
    sample = read_manifest(tiny_dataset.folder).groups[0].samples[3]
    said = read_exr_attributes(tiny_dataset.folder / sample.target)
    assert said["sixway/dataset"] == "test_tiny"
    assert said["sixway/simulation"] == sample.simulation
    assert (said["sixway/frame"], said["sixway/seed"]) == (sample.frame, sample.seed)


def test_a_truncated_frame_is_found_by_verify_and_by_pack(own_copy: Path, generate: Generate, capsys: Any) -> None:
    path = next(own_copy.glob("target/jet/*/*/frame_0000.exr"))
    path.write_bytes(path.read_bytes()[:-60])
    assert generate(own_copy, only=("verify",)) == 1
    remedy = "its hash differs from the recorded one; delete it and run the generation command again"
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"error: {path}: {remedy}"
    for packed in own_copy.glob("packed/train_*_target_*.npy"):
        packed.unlink()
    assert generate(own_copy, only=("pack",)) == 2
    told = capsys.readouterr().err
    assert str(path) in told and "delete the file and run the generation command again" in told


def test_a_frame_that_was_truncated_before_it_was_recorded_is_found_too(
    own_copy: Path, generate: Generate, capsys: Any
) -> None:
    path = next(own_copy.glob("flow/jet_test/*/*/frame_*.exr"))
    path.write_bytes(path.read_bytes()[:-60])
    index = path.parent / INDEX
    with index.open("a") as file:
        file.write(json.dumps({"file": path.name, "sha256": sha256_file(path)}) + "\n")
    assert generate(own_copy, only=("verify",)) == 1
    told = capsys.readouterr().err
    assert str(path) in told and "delete the file and run the generation command again" in told
    assert generate(own_copy, only=("pack",)) == 2
    assert str(path) in capsys.readouterr().err


def test_following_the_remedy_mends_the_dataset(
    tiny_dataset: Any, own_copy: Path, generate: Generate, contents: Contents
) -> None:
    path = next(own_copy.glob("guide_paper/jet_val/*/*/frame_0001.exr"))
    path.write_bytes(b"")
    assert generate(own_copy, only=("verify",)) == 1
    path.unlink()
    assert generate(own_copy) == 0
    assert contents(own_copy) == contents(tiny_dataset.folder)


def test_a_recorded_hash_that_differs_is_told(own_copy: Path, generate: Generate, capsys: Any) -> None:
    path = next(own_copy.glob("density/jet_val/*/frame_0004.npz"))
    index = path.parent / INDEX
    index.write_text(index.read_text().replace(sha256_file(path), "0" * 64))
    assert generate(own_copy, only=("verify",)) == 1
    assert f"{path}: its hash differs from the recorded one" in capsys.readouterr().err


def test_a_damaged_packed_array_is_found_and_the_same_command_mends_it(
    tiny_dataset: Any, own_copy: Path, generate: Generate, contents: Contents, capsys: Any
) -> None:
    path = next(own_copy.glob("packed/train_*_target_*.npy"))
    content = bytearray(path.read_bytes())
    content[-101] ^= 0x40
    path.write_bytes(content)
    assert generate(own_copy, only=("verify",)) == 1
    assert f"{path}: missing or altered" in capsys.readouterr().err
    assert generate(own_copy) == 0
    assert contents(own_copy) == contents(tiny_dataset.folder)


def test_the_manifest_is_made_anew_if_it_is_junk(
    tiny_dataset: Any, own_copy: Path, generate: Generate, contents: Contents, capsys: Any
) -> None:
    (own_copy / MANIFEST).write_text('{"format": 1')
    assert generate(own_copy, only=("verify",)) == 1
    assert MANIFEST in capsys.readouterr().err
    assert generate(own_copy) == 0
    assert contents(own_copy) == contents(tiny_dataset.folder)


def test_packing_replaces_what_the_plan_has_outgrown(own_copy: Path, generate: Generate) -> None:
    before = {path.name for path in own_copy.glob("packed/*.npy")}
    assert generate(own_copy, "pairs_per_simulation=1", only=("pack",)) == 0
    after = {path.name for path in own_copy.glob("packed/*.npy")}
    assert len(after) == len(before) and not after & before
    assert all(len(group.samples) == 4 for group in read_manifest(own_copy).groups)


def test_references_without_light_are_refused(own_copy: Path, generate: Generate, capsys: Any) -> None:
    for index in own_copy.glob(f"target/jet/*/*/{INDEX}"):
        lines = []
        for record in read_json_lines(index):
            path = index.parent / record["file"]
            write_exr(path, np.zeros((20, 24, 7), np.float32), TARGET_CHANNELS)
            lines.append(json.dumps({**record, "sha256": sha256_file(path)}) + "\n")
        index.write_text("".join(lines))
    assert generate(own_copy, only=("pack",)) == 2
    assert "hold no light at all; check the medium's extinction" in capsys.readouterr().err


def test_every_reference_tells_its_noise(tiny_dataset: Any) -> None:
    manifest = read_manifest(tiny_dataset.folder)
    noise = {}
    for index in tiny_dataset.folder.glob(f"target/*/*/*/{INDEX}"):
        for record in read_json_lines(index):
            path = index.parent / record["file"]
            said = read_exr_attributes(path)
            assert said["sixway/noise_rmse"] == pytest.approx(record["noise_rmse"], rel=1e-6)
            maps = read_exr(path, TARGET_CHANNELS)[..., :6]
            peak = np.percentile(maps, 99.9)
            assert record["noise_psnr_db"] == pytest.approx(20.0 * np.log10(peak / record["noise_rmse"]), abs=0.05)
            noise[str(path.relative_to(tiny_dataset.folder))] = record["noise_rmse"]
    assert len(noise) == 24
    assert manifest.noise is not None
    assert manifest.noise.median_rmse == pytest.approx(manifest.scale * np.median(list(noise.values())))
    assert manifest.noise.worst_rmse == pytest.approx(manifest.scale * noise[manifest.noise.worst_frame])
    assert noise[manifest.noise.worst_frame] == max(noise.values())


def test_a_dataset_with_one_burning_scene_has_emissive_targets_everywhere(
    tiny_dataset: Any, own_copy: Path, generate: Generate
) -> None:
    """Fire in the validation jet alone, as a burning simulation would write it."""
    for path in own_copy.glob("density/jet_val/*/frame_*.npz"):
        frame = read_npz(path)
        write_npz(path, replace(frame, emission=10.0 * frame.density))
        index = path.parent / INDEX
        records = {record["file"]: record for record in read_json_lines(index)}
        records[path.name]["sha256"] = sha256_file(path)
        index.write_text("".join(json.dumps(record) + "\n" for record in records.values()))
    for path in own_copy.glob("target/jet_val/*/*/frame_*.exr"):
        path.unlink()
    assert generate(own_copy) == 0  # verified too
    assert not SmokeDataset(tiny_dataset.folder, guide="six", split="val").has_emissive
    burning, cold = (SmokeDataset(own_copy, guide="six", split=split) for split in ("val", "train"))
    assert burning.has_emissive and cold.has_emissive
    assert burning.target_channels == LIGHTMAP_CHANNELS
    pair = burning.pair(0, 0).target.numpy()
    assert pair[:, 7].max() > 0.1
    assert pair[:, 7][pair[:, 6] == 0.0].max() < 1e-3  # it burns where smoke is
    assert not cold.pair(0, 0).target[:, 7].any()
    old, new = (SmokeDataset(folder, guide="six", split="train") for folder in (tiny_dataset.folder, own_copy))
    np.testing.assert_array_equal(old.pair(0, 0).target, new.pair(0, 0).target)
