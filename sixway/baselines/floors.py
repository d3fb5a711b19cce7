"""What a net must beat: answers that need no net at all, in the net's own encoding.

Each is fitted on the training split alone and answers a raw guide [n, g, h, w] as a net would.
"""

import numpy as np
import torch
from torch.nn.functional import interpolate

from sixway.baselines.billboard import Billboard
from sixway.baselines.encoding import Encoded, Guide, conditioning, encode_target
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample


class MeanImage:
    """The mean of the training targets of that image size, whatever the guide shows.

    Of a size that training never saw: the mean of the largest trained size, resampled.
    """

    name = "mean image"

    def __init__(self, dataset: SmokeDataset) -> None:
        self._means: dict[tuple[int, int], np.ndarray] = {}
        for number, group in enumerate(dataset.groups):
            pairs = range(len(group.samples) // 2)
            targets = (encode_target(dataset, dataset.pair(number, row)).mean(0, dtype=np.float64) for row in pairs)
            self._means[(group.height_px, group.width_px)] = np.mean(list(targets), axis=0).astype(np.float32)

    def answer(self, guide: Guide, samples: tuple[Sample, ...]) -> Encoded:
        size = (guide.shape[2], guide.shape[3])
        if size not in self._means:
            largest = torch.from_numpy(self._means[max(self._means)][None])
            self._means[size] = interpolate(largest, size, mode="bilinear", antialias=True)[0].numpy()
        return np.repeat(self._means[size][None], len(guide), axis=0)


class LinearFit:
    """Each map as the best linear mix of the guide's channels (as the net sees them) and a constant, for all sizes."""

    name = "linear fit"

    def __init__(self, dataset: SmokeDataset) -> None:
        self._conditioning = conditioning(dataset)
        features = len(dataset.guide_channels) + 1
        gram = np.zeros((features, features))
        moment = np.zeros((features, len(LIGHTMAP_CHANNELS)))
        for number, group in enumerate(dataset.groups):
            for row in range(len(group.samples) // 2):
                pair = dataset.pair(number, row)
                x = self._features(pair.guide.numpy())
                y = np.moveaxis(encode_target(dataset, pair), 1, -1).reshape(-1, len(LIGHTMAP_CHANNELS))
                gram += x.T @ x
                moment += x.T @ y
        self._weights = np.linalg.lstsq(gram, moment, rcond=None)[0]

    def answer(self, guide: Guide, samples: tuple[Sample, ...]) -> Encoded:
        n, _, h, w = guide.shape
        answer = (self._features(guide) @ self._weights).reshape(n, h, w, len(LIGHTMAP_CHANNELS))
        return np.maximum(np.moveaxis(answer, -1, 1), 0.0).astype(np.float32)

    def _features(self, guide: Guide) -> np.ndarray:
        with torch.inference_mode():
            conditioned = self._conditioning(torch.from_numpy(guide)).numpy().astype(np.float64)
        flat = np.moveaxis(conditioned, 1, -1).reshape(-1, conditioned.shape[1])
        return np.concatenate([flat, np.ones((len(flat), 1))], axis=1)


class CoarseMaps:
    """The guide's own maps, 1 - T and fire as they are; only for a guide with a channel for every light."""

    name = "guide as it is"

    def __init__(self, dataset: SmokeDataset) -> None:
        if not set(DIRECTIONS) <= set(dataset.guide_channels):
            raise ValueError(f"the guide {dataset.guide_channels} shows no map of every direction")
        self._channels = dataset.guide_channels
        self._conditioning = conditioning(dataset)

    def answer(self, guide: Guide, samples: tuple[Sample, ...]) -> Encoded:
        with torch.inference_mode():
            conditioned = self._conditioning(torch.from_numpy(guide)).numpy()
        answer = np.zeros((len(guide), len(LIGHTMAP_CHANNELS), *guide.shape[2:]), np.float32)
        for i, name in enumerate(LIGHTMAP_CHANNELS):
            shown_as = "transmittance" if name == "alpha" else name
            if shown_as in self._channels:
                answer[:, i] = conditioned[:, self._channels.index(shown_as)]
        return answer


def floors(train: SmokeDataset, test: SmokeDataset) -> list[MeanImage | LinearFit | CoarseMaps | Billboard]:
    """Every floor that the guide and the views allow: fitted on `train`, the billboard baked from `test`."""
    found: list[MeanImage | LinearFit | CoarseMaps | Billboard] = [MeanImage(train), LinearFit(train)]
    if set(DIRECTIONS) <= set(train.guide_channels):
        found.append(CoarseMaps(train))
    if (billboard := Billboard(test)).turns:
        found.append(billboard)
    return found
