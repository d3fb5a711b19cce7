"""The packed arrays of a dataset, memory-mapped: what training and evaluation read."""

from pathlib import Path

import numpy as np
import torch

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import content_hash, inside, sha256_file
from sixway.data.augment import check_summed_lights, flip_pair
from sixway.data.clips import Batch
from sixway.data.manifest import Group, Manifest, PackedArray, Split, read_manifest


class SmokeDataset:
    """One split of a dataset under one guide variant.

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
        self.flows = [_open(folder, g, g.arrays["flow"]) if "flow" in g.arrays else None for g in self.groups]
        self.guide_channels = self.groups[0].arrays[name].channels
        self.target_channels = self.groups[0].arrays["target"].channels
        self.guide_config = self.manifest.guides[guide]

    def __len__(self) -> int:
        """Number of frames; pairs of consecutive frames are half as many."""
        return sum(len(group.samples) for group in self.groups)

    @property
    def has_emissive(self) -> bool:
        return "emissive" in self.target_channels

    @property
    def identity(self) -> str:
        """Hash of all that a net sees of this split: pixels and brightness scale."""
        names = (f"guide_{self.guide}", "target")
        return content_hash([self.manifest.scale, [group.arrays[n].sha256 for group in self.groups for n in names]])

    def batch(self, rng: np.random.Generator, *, num_pairs: int, flip: bool) -> Batch:
        """Pairs drawn with replacement from one image size, each flipped by chance.

        Raises ValueError if flips are asked for and this guide has no such symmetry.
        """
        if flip and self.guide_config["sum_lights"]:
            check_summed_lights(self.guide_config["lights"])
        sizes = np.array([len(group.samples) for group in self.groups], dtype=np.float64)
        which = int(rng.choice(len(sizes), p=sizes / sizes.sum()))
        rows = rng.integers(len(self.groups[which].samples) // 2, size=num_pairs)
        guides, targets = [], []
        for row in rows:
            pair = self.pair(which, int(row))
            if flip:
                pair = flip_pair(
                    pair, self.guide_channels, horizontal=bool(rng.integers(2)), vertical=bool(rng.integers(2))
                )
            guides.append(pair.guide)
            targets.append(pair.target)
        return Batch(guide=torch.cat(guides), target=torch.cat(targets))

    def pair(self, group: int, row: int) -> Batch:
        """The consecutive frames 2 * row and 2 * row + 1 of a group, float32."""
        rows = slice(2 * row, 2 * row + 2)
        target = np.zeros((2, len(LIGHTMAP_CHANNELS), *self._targets[group].shape[2:]), np.float32)
        target[:, : len(self.target_channels)] = self._targets[group][rows]
        return Batch(
            guide=torch.from_numpy(self._guides[group][rows].astype(np.float32)),
            target=torch.from_numpy(target),
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
