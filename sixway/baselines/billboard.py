"""What games have today: maps baked from one view of the smoke, shown on a card that turns to the camera.

Seen from elsewhere the card still shows the first view. Its lights stay relative to the camera, as in the engines.
"""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn.functional import grid_sample

from sixway.baselines.encoding import Encoded, Guide, encode_target
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Sample


@dataclass(frozen=True)
class _Baked:
    """A frame that may serve as the bake, and where it stands in the packed arrays."""

    sample: Sample
    size: tuple[int, int]
    group: int
    index: int


class Billboard:
    """The true maps of the same smoke at the view nearest to yaw 0 and pitch 0, nearer or farther as the camera is.

    The truth stands in for a bake, so noise and fit cost nothing: all that is wrong is the view.
    """

    name = "billboard baked at yaw 0"

    def __init__(self, dataset: SmokeDataset) -> None:
        self._dataset = dataset
        self._frames: dict[tuple[str, int, float], list[_Baked]] = defaultdict(list)
        for number, group in enumerate(dataset.groups):
            for index, sample in enumerate(group.samples):
                size = (group.height_px, group.width_px)
                self._frames[_smoke(sample)].append(_Baked(sample, size, number, index))

    @property
    def turns(self) -> bool:
        """Whether any view differs from the baked one; without, there is nothing to answer."""
        return any(len({_direction(baked.sample) for baked in frames}) > 1 for frames in self._frames.values())

    def answer(self, guide: Guide, samples: tuple[Sample, ...]) -> Encoded | None:
        """None for the baked view itself, which the card shows as it is. Both frames of a pair have one view."""
        shown = []
        for sample in samples:
            baked = self._bake_of(sample, (guide.shape[2], guide.shape[3]))
            if _direction(sample) == _direction(baked.sample):
                return None
            row, second = divmod(baked.index, 2)
            truth = encode_target(self._dataset, self._dataset.pair(baked.group, row))[second]
            # a camera that frames `margin` times as much sees the card that much smaller
            shown.append(_resampled(truth, (guide.shape[2], guide.shape[3]), sample.margin / baked.sample.margin))
        return np.stack(shown)

    def _bake_of(self, sample: Sample, size: tuple[int, int]) -> _Baked:
        """Of the least turned ones, that of the same size or else the largest."""
        return min(self._frames[_smoke(sample)], key=lambda b: (_turned(b.sample), b.size != size, -b.size[0]))


def _smoke(sample: Sample) -> tuple[str, int, float]:
    return sample.simulation, sample.frame, sample.density_scale


def _turned(sample: Sample) -> float:
    """Degrees away from yaw 0 and pitch 0, roughly."""
    yaw = abs((sample.yaw_deg + 180.0) % 360.0 - 180.0)
    return float(np.hypot(yaw, sample.pitch_deg))


def _direction(sample: Sample) -> tuple[float, float]:
    return sample.yaw_deg, sample.pitch_deg


def _resampled(image: np.ndarray, size: tuple[int, int], farther: float) -> np.ndarray:
    """[c, h, w] about its centre at another size, seen from `farther` times the distance; nothing beyond its edges."""
    places = []
    for pixels, baked in zip(size, image.shape[1:], strict=True):
        half = pixels / min(size) / (baked / min(image.shape[1:]))  # margin frames the shorter side
        places.append(((torch.arange(pixels) + 0.5) / pixels * 2.0 - 1.0) * farther * half)
    v, u = torch.meshgrid(*places, indexing="ij")
    where = torch.stack([u, v], dim=-1)[None]
    moved = grid_sample(
        torch.from_numpy(image)[None], where, mode="bilinear", padding_mode="zeros", align_corners=False
    )
    answer: np.ndarray = moved[0].numpy()
    return answer
