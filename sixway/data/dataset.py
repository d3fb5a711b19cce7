"""The packed arrays of a dataset, memory-mapped: what training and evaluation read."""

from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import content_hash, inside, sha256_file
from sixway.data.augment import check_summed_lights, flip_pair
from sixway.data.clips import Batch, join
from sixway.data.manifest import Group, GuideLights, Manifest, PackedArray, Split, read_manifest

Draw = Literal["pictures", "sizes"]
"""How a batch's image size is drawn: every picture is seen equally often, or every size has an equal share."""


class SmokeDataset:
    """One split of a dataset under one guide variant.

    pair_flows: None, or for each group the motion of its pairs [n/2, 2, h, w], which batches then carry.
    Raises ValueError if the guide variant is unknown, or a packed file differs from the manifest's hash.
    """

    def __init__(self, folder: Path, *, guide: str, split: Split) -> None:
        self.manifest: Manifest = read_manifest(folder)
        if guide not in self.manifest.guides:
            known = ", ".join(sorted(self.manifest.guides))
            raise ValueError(f"{folder}: no guide variant {guide!r}; this dataset has: {known}")
        self.guide = guide
        self.groups = self.manifest.split(split)
        name = f"guide_{guide}"
        self._guides = [_open(folder, group, group.arrays[name]) for group in self.groups]
        self._targets = [_open(folder, group, group.arrays["target"]) for group in self.groups]
        self.pair_flows: list[np.ndarray] | None = None
        self.flows = [_open(folder, g, g.arrays["flow"]) if "flow" in g.arrays else None for g in self.groups]
        self.guide_channels = self.groups[0].arrays[name].channels
        self.target_channels = self.groups[0].arrays["target"].channels
        self.guide_identity = self.manifest.guides[guide]
        self._lights = GuideLights.model_validate(self.guide_identity)

    def __len__(self) -> int:
        """Number of frames; pairs of consecutive frames are half as many."""
        return sum(len(group.samples) for group in self.groups)

    @property
    def has_emissive(self) -> bool:
        return "emissive" in self.target_channels

    @property
    def scale(self) -> float:
        """Brightness scale of the six maps."""
        return self.manifest.scale

    @property
    def emissive_scale(self) -> float | None:
        """Brightness scale of fire; None for a dataset without."""
        return self.manifest.emissive_scale

    @property
    def identity(self) -> str:
        """Hash of all that a net sees of this split: pixels and brightness scales."""
        names = (f"guide_{self.guide}", "target")
        scales = [self.scale, self.emissive_scale]
        return content_hash([scales, [group.arrays[n].sha256 for group in self.groups for n in names]])

    def batch(self, rng: np.random.Generator, *, num_pairs: int, flip: bool, draw: Draw = "pictures") -> Batch:
        """Pairs drawn with replacement from one image size, each flipped by chance.

        num_pairs: of the smallest size; larger ones take fewer, so that batches hold about as many pixels.
        Raises ValueError if flips are asked for and this guide has no such symmetry.
        """
        if flip and self._lights.sum_lights:
            check_summed_lights(self._lights.lights)
        counts = self._pairs_per_batch(num_pairs)
        which = int(rng.choice(len(counts), p=self._chances(counts, draw)))
        rows = rng.integers(len(self.groups[which].samples) // 2, size=counts[which])
        pairs = []
        for row in rows:
            pair = self.pair(which, int(row))
            if flip:
                pair = flip_pair(
                    pair, self.guide_channels, horizontal=bool(rng.integers(2)), vertical=bool(rng.integers(2))
                )
            pairs.append(pair)
        return join(pairs)

    def _pairs_per_batch(self, num_pairs: int) -> np.ndarray:
        """Of each group."""
        areas = np.array([group.height_px * group.width_px for group in self.groups])
        return np.maximum(1, np.round(num_pairs * areas.min() / areas)).astype(int)

    def _chances(self, counts: np.ndarray, draw: Draw) -> np.ndarray:
        """Probability of each group to be the one of a batch that holds so many of its pairs."""
        assert draw in get_args(Draw)
        if draw == "sizes":
            return np.full(len(counts), 1.0 / len(counts))
        batches = np.array([len(group.samples) for group in self.groups]) / counts
        return batches / batches.sum()

    def pair(self, group: int, row: int) -> Batch:
        """The consecutive frames 2 * row and 2 * row + 1 of a group, float32."""
        rows = slice(2 * row, 2 * row + 2)
        target = np.zeros((2, len(LIGHTMAP_CHANNELS), *self._targets[group].shape[2:]), np.float32)
        target[:, : len(self.target_channels)] = self._targets[group][rows]
        flow = None if self.pair_flows is None else self.pair_flows[group][row : row + 1].astype(np.float32)
        return Batch(
            guide=torch.from_numpy(self._guides[group][rows].astype(np.float32)),
            target=torch.from_numpy(target),
            flow=None if flow is None else torch.from_numpy(flow),
        )


def _open(folder: Path, group: Group, array: PackedArray) -> np.ndarray:
    path = inside(folder, array.path)
    remedy = "run the generation command again: it packs anew what differs"
    if not path.is_file():
        raise FileNotFoundError(f"{path}: this packed array is missing; {remedy}")
    if sha256_file(path) != array.sha256:
        raise ValueError(f"{path}: its hash differs from the one in the manifest; {remedy}")
    values = np.load(path, mmap_mode="r", allow_pickle=False)
    expected = (len(group.samples), len(array.channels), group.height_px, group.width_px)
    if values.shape != expected or values.dtype != np.float16:
        raise ValueError(f"{path}: holds {values.dtype} {values.shape}, expected float16 {expected}; {remedy}")
    return values
