"""How good the averaged net is by now, on pairs that it never trains on: a score and a picture."""

import math
from pathlib import Path

import numpy as np
import torch

from sixway.core.conventions import DIRECTIONS
from sixway.core.png import to_8bit, write_8bit_png
from sixway.data.dataset import SmokeDataset
from sixway.models.encoding import encode_lightmap
from sixway.models.unet import SixWayUNet

SCORE = "validation_psnr_db"
_PAIRS_PER_SIZE = 16
_GUTTER_PX = 2
_DIFFERENCE_GAIN = 5.0


@torch.no_grad()
def validate(net: SixWayUNet, dataset: SmokeDataset, *, device: str) -> dict[str, float]:
    """PSNR [dB] of the mean squared error of the six maps in sRGB, over the same evenly spaced pairs every time.

    Overall (`SCORE`; every pair counts alike) and, where there are several image sizes, of each.
    """
    errors: dict[str, list[float]] = {}
    for number, group in enumerate(dataset.groups):
        pairs = len(group.samples) // 2
        squares = []
        for row in np.linspace(0, pairs - 1, min(pairs, _PAIRS_PER_SIZE)).round().astype(int):
            predicted, true = _maps(net, dataset, number, int(row), device=device)
            squares.append((predicted - true).square().mean())
        errors[f"validation_psnr_{group.height_px}x{group.width_px}_db"] = torch.stack(squares).tolist()
    scores = {SCORE: _psnr_db([error for of_size in errors.values() for error in of_size])}
    if len(errors) > 1:
        scores |= {name: _psnr_db(of_size) for name, of_size in errors.items()}
    return scores


@torch.no_grad()
def picture(net: SixWayUNet, dataset: SmokeDataset, *, device: str) -> np.ndarray:
    """The middle frame of each image size, [h, w, 3] bytes ready to display.

    For each size four rows: the guide's channels as the net reads them; the six maps in the order of
    `DIRECTIONS`, predicted; true; and five times their difference, grey where they are equal.
    """
    rows = []
    for number, group in enumerate(dataset.groups):
        row = len(group.samples) // 4
        guide = net.conditioning(dataset.pair(number, row).guide[:1].to(device))[0]
        predicted, true = (maps[0] for maps in _maps(net, dataset, number, row, device=device))
        difference = 0.5 + _DIFFERENCE_GAIN * (predicted - true)
        rows += [_row(channels.cpu().numpy()) for channels in (guide, predicted, true, difference)]
    width = max(row.shape[1] for row in rows)
    return np.concatenate([np.pad(row, ((0, _GUTTER_PX), (0, width - row.shape[1]), (0, 0))) for row in rows])


def write_picture(path: Path, pixels: np.ndarray) -> None:
    """Write what `picture` made, atomically."""
    write_8bit_png(path, pixels)


def _maps(
    net: SixWayUNet, dataset: SmokeDataset, group: int, row: int, *, device: str
) -> tuple[torch.Tensor, torch.Tensor]:
    """The six maps of a pair, predicted and true, encoded. Less than no light is none, as in every score."""
    pair = dataset.pair(group, row).to(device)
    true = encode_lightmap(pair.target, scale=dataset.scale)
    lit = len(DIRECTIONS)
    return net(pair.guide).float()[:, :lit].clamp_min(0.0), true[:, :lit]


def _row(channels: np.ndarray) -> np.ndarray:
    """Channels [c, h, w] side by side as grey bytes [h, w', 3]."""
    tiles = [np.pad(to_8bit(channel[..., None]), ((0, 0), (0, _GUTTER_PX), (0, 0))) for channel in channels]
    return np.repeat(np.concatenate(tiles, axis=1), 3, axis=-1)


def _psnr_db(errors: list[float]) -> float:
    return -10.0 * math.log10(max(sum(errors) / len(errors), 1e-12))
