"""Frames on disk -> the arrays that training reads, and the manifest that describes the whole dataset."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr
from sixway.core.progress import track
from sixway.core.store import (
    append_json_line,
    atomic_path,
    content_hash,
    provenance,
    read_json_lines,
    sha256_file,
    write_text,
    write_with_holes,
)
from sixway.data.manifest import MANIFEST, Group, Manifest, PackedArray, Sample, Split
from sixway.generation.cameras import DatasetView
from sixway.generation.card import write_card
from sixway.generation.jobs import INDEX
from sixway.generation.noise import reference_noise_psnr_db, summarised
from sixway.generation.plan import Folder, PlannedSimulation
from sixway.generation.stages import FLOW_CHANNELS, TARGET_CHANNELS, Generation, channels_of

Row = tuple[PlannedSimulation, DatasetView, int]
Made = tuple[Path, dict[str, Any]]
"""A finished frame and its record."""

_SCALE_PERCENTILE = 99.9
_HISTOGRAM_EDGES = np.concatenate([[0.0], np.geomspace(1e-4, 1e3, 100_001)])
"""Bins 0.016 % wide: the percentile of any number of frames in bounded memory."""


def pack(job: Generation) -> Manifest:
    """Pack every split and image size and write `manifest.json`; unchanged arrays are kept.

    Targets have an emissive channel if any frame could burn; it is 0 where a frame could not.
    Raises FileNotFoundError or CorruptFrameError naming the frame that is missing or damaged, ValueError
    if there is no training frame with light in it.
    """
    rows_of = _grouped(job)
    targets = {key: [_recorded(job, job.plan.target(s, v), f) for s, v, f in rows] for key, rows in rows_of.items()}
    all_targets = [made for group in targets.values() for made in group]
    burns = any("emissive" in record.get("channels", ()) for _, record in all_targets)
    channels = LIGHTMAP_CHANNELS if burns else TARGET_CHANNELS
    groups = [_pack_group(job, key[0], rows, targets[key], channels) for key, rows in rows_of.items()]
    scale = _brightness_scale(job.out, groups)
    noise = {
        str(path.relative_to(job.out)): record["noise_rmse"] for path, record in all_targets if "noise_rmse" in record
    }
    manifest = Manifest(
        name=job.plan.config.name,
        scale=scale,
        emissive_scale=_emissive_scale(job.out, groups),
        medium=job.plan.config.medium.identity(),
        guides={name: guide.identity() for name, guide in job.plan.config.guides.items()},
        groups=tuple(groups),
        noise_psnr_db=reference_noise_psnr_db(job, scale=scale),
        noise=summarised(noise, scale=scale) if noise else None,
        config=job.plan.config.model_dump(mode="json"),
        provenance=provenance(),
    )
    write_card(job.out, manifest, job.plan)
    write_text(job.out / MANIFEST, manifest.model_dump_json(indent=1) + "\n")
    return manifest


def _grouped(job: Generation) -> dict[tuple[Split, int, int], list[Row]]:
    """Rows of one split and image size, frames of a pair side by side."""
    groups: dict[tuple[Split, int, int], list[Row]] = defaultdict(list)
    for simulation in job.plan.simulations:
        for view in simulation.views:
            key = (simulation.split, view.camera.height_px, view.camera.width_px)
            groups[key] += [(simulation, view, frame) for frame in simulation.frames]
    return groups


def _pack_group(
    job: Generation, split: Split, rows: list[Row], targets: list[Made], target_channels: tuple[str, ...]
) -> Group:
    plan = job.plan
    camera = rows[0][1].camera
    arrays = {"target": _pack_array(job, "target", split, targets, target_channels, camera)}
    for name, guide in plan.config.guides.items():
        files = [_recorded(job, plan.guide(name, s, v), f) for s, v, f in rows]
        arrays[f"guide_{name}"] = _pack_array(job, f"guide_{name}", split, files, guide.channels, camera)
    if split != "train":  # evaluation alone reads it
        files = [_recorded(job, plan.flow(s, v), f) for s, v, f in rows]
        arrays["flow"] = _pack_array(job, "flow", split, files, FLOW_CHANNELS, camera)
    samples = tuple(
        Sample(
            simulation=simulation.name,
            view=view.name,
            frame=frame,
            yaw_deg=view.yaw_deg,
            pitch_deg=view.pitch_deg,
            margin=view.margin,
            density_scale=view.density_scale,
            seed=record["seed"],
            target=str(path.relative_to(job.out)),
            target_sha256=record["sha256"],
        )
        for (simulation, view, frame), (path, record) in zip(rows, targets, strict=True)
    )
    return Group(split=split, height_px=camera.height_px, width_px=camera.width_px, arrays=arrays, samples=samples)


def _recorded(job: Generation, folder: Folder, frame: int) -> Made:
    """A finished frame and its record; raises FileNotFoundError if it is not finished."""
    store = job.store(folder)
    path = store.frame_path(frame, ".exr")
    record = store.record_of(path)
    if record is None:
        raise FileNotFoundError(f"{path}: this frame is missing; run the generation command again to make it")
    return path, record


def _pack_array(
    job: Generation, layer: str, split: Split, files: list[Made], channels: tuple[str, ...], camera: Any
) -> PackedArray:
    """Stack EXR frames into one float16 .npy [n, c, h, w], named by the hashes of what went in.

    A frame that holds the first channels only is 0 in the others. What is empty takes no disk. A finished array is
    recorded with its own hash; one that differs from its record is packed anew.
    """
    name = f"{split}_{camera.width_px}x{camera.height_px}_{layer}"
    key = content_hash([channels, [record["sha256"] for _, record in files]])
    path = job.out / "packed" / f"{name}_{key}.npy"
    recorded = {record["file"]: record["sha256"] for record in read_json_lines(path.parent / INDEX)}
    if not path.is_file() or sha256_file(path) != recorded.get(path.name):
        shape = (len(files), len(channels), camera.height_px, camera.width_px)
        header = {"descr": "<f2", "fortran_order": False, "shape": shape}
        # written, not memory-mapped: a full disk is an error here and kills the process there
        with atomic_path(path) as temporary, temporary.open("wb") as file:
            np.lib.format.write_array_header_1_0(file, header)
            for frame, record in track(files, total=len(files), label=f"pack {name}"):
                if sha256_file(frame) != record["sha256"]:
                    raise ValueError(
                        f"{frame}: its hash differs from the one recorded when it was made; delete the file and "
                        "run the generation command again"
                    )
                held = channels_of(record, channels)
                image = np.zeros((len(channels), camera.height_px, camera.width_px), "<f2")
                image[: len(held)] = np.moveaxis(read_exr(frame, held, image.shape[1:]), -1, 0)
                write_with_holes(file, image.tobytes())
            file.truncate(file.tell())
        append_json_line(path.parent / INDEX, {"file": path.name, "sha256": sha256_file(path)})
        for old in path.parent.glob(f"{name}_*.npy"):
            if old != path and len(old.stem) == len(path.stem):
                old.unlink()
    return PackedArray(path=str(path.relative_to(job.out)), sha256=sha256_file(path), channels=channels)


def _brightness_scale(out: Path, groups: list[Group]) -> float:
    """The factor that puts the 99.9th percentile of the training maps at 1. Raises ValueError where all is dark."""
    counts = _histogram(out, groups, slice(0, len(DIRECTIONS)))
    if not counts[1:].any():
        raise ValueError("the training references hold no light at all; check the medium's extinction and the splits")
    return _scale(counts)


def _emissive_scale(out: Path, groups: list[Group]) -> float | None:
    """The same for fire, over the pixels that burn, so that it does not depend on how many scenes do; None without."""
    counts = _histogram(out, groups, slice(len(TARGET_CHANNELS), len(LIGHTMAP_CHANNELS)))
    counts[0] = 0
    return _scale(counts) if counts.any() else None


def _histogram(out: Path, groups: list[Group], channels: slice) -> np.ndarray:
    counts = np.zeros(len(_HISTOGRAM_EDGES) - 1, np.int64)
    for group in groups:
        if group.split == "train":
            for image in np.load(out / group.arrays["target"].path, mmap_mode="r"):
                counts += np.histogram(image[channels].astype(np.float32), bins=_HISTOGRAM_EDGES)[0]
    return counts


def _scale(counts: np.ndarray) -> float:
    place = int(np.searchsorted(np.cumsum(counts), counts.sum() * _SCALE_PERCENTILE / 100.0))
    return float(1.0 / _HISTOGRAM_EDGES[place + 1])
