"""A card that shows the view it was baked from: exact where nothing turns, wrong by the turn elsewhere."""

import numpy as np
import pytest
import torch

from sixway.baselines.billboard import Billboard
from sixway.core.color import encode_srgb
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.data.clips import Batch
from sixway.data.dataset import SmokeDataset
from sixway.data.manifest import Group, Sample

CHANNELS = len(LIGHTMAP_CHANNELS)


class Held(SmokeDataset):
    """Targets in memory: linear [n, 8, h, w] for each group, scale 1."""

    scale, emissive_scale = 1.0, None

    def __init__(self, groups: list[list[Sample]], targets: list[np.ndarray]) -> None:
        self._held = targets
        self.groups = tuple(
            Group(split="test", height_px=t.shape[2], width_px=t.shape[3], arrays={}, samples=tuple(samples))
            for samples, t in zip(groups, targets, strict=True)
        )

    def pair(self, group: int, row: int) -> Batch:
        target = torch.from_numpy(self._held[group][2 * row : 2 * row + 2])
        return Batch(guide=torch.zeros(2, 3, *target.shape[2:]), target=target)


def view(yaw: float, *, pitch: float = 0.0, margin: float = 1.0, density: float = 1.0) -> list[Sample]:
    """The pair of frames 4 and 5 of one simulation."""
    return [
        Sample(
            simulation="jet",
            view=f"{yaw}/{pitch}/{margin}/{density}",
            frame=frame,
            yaw_deg=yaw,
            pitch_deg=pitch,
            margin=margin,
            density_scale=density,
            seed=0,
            target="",
            target_sha256="",
        )
        for frame in (4, 5)
    ]


def answered(held: Held, group: int, row: int) -> np.ndarray | None:
    target = held._held[group]
    guide = np.zeros((2, 3, *target.shape[2:]), np.float32)
    return Billboard(held).answer(guide, held.groups[group].samples[2 * row : 2 * row + 2])


def blob(size: tuple[int, int], radius: float, level: float) -> np.ndarray:
    """A soft disc in all channels, [2, 8, h, w]; radius in halves of the shorter side; frame 5 is twice as bright."""
    height, width = size
    short = min(size)
    v = ((np.arange(height) + 0.5) * 2.0 - height) / short
    u = ((np.arange(width) + 0.5) * 2.0 - width) / short
    disc = np.exp(-((u[None] ** 2 + v[:, None] ** 2) / radius**2) * 3.0)
    return np.stack([np.broadcast_to(level * k * disc, (CHANNELS, *size)) for k in (1.0, 2.0)]).astype(np.float32)


def test_other_yaws_show_the_frame_of_the_baked_view(rng: np.random.Generator) -> None:
    targets = rng.random((6, CHANNELS, 8, 10), dtype=np.float32)
    held = Held([[*view(60.0), *view(0.0), *view(-30.0)]], [targets])
    baked = targets[2:4].copy()
    light = [i for i, name in enumerate(LIGHTMAP_CHANNELS) if name != "alpha"]
    baked[:, light] = encode_srgb(baked[:, light])
    for row in (0, 2):
        np.testing.assert_allclose(answered(held, 0, row), baked, atol=1e-5)
    assert answered(held, 0, 1) is None  # the baked view itself proves nothing
    assert Billboard(held).turns


def test_the_nearest_turn_is_baked_and_pitch_counts(rng: np.random.Generator) -> None:
    targets = rng.random((6, CHANNELS, 8, 8), dtype=np.float32)
    held = Held([[*view(10.0, pitch=30.0), *view(350.0), *view(45.0)]], [targets])
    assert answered(held, 0, 1) is None  # 350 is 10 degrees away from 0
    assert answered(held, 0, 0) is not None and answered(held, 0, 2) is not None


def test_densities_have_bakes_of_their_own(rng: np.random.Generator) -> None:
    targets = rng.random((4, CHANNELS, 8, 8), dtype=np.float32)
    held = Held([[*view(0.0), *view(45.0, density=2.0)]], [targets])
    assert answered(held, 0, 1) is None
    assert not Billboard(held).turns


@pytest.mark.parametrize("size", [(40, 40), (80, 80), (40, 60), (60, 40)])
def test_a_farther_camera_sees_a_smaller_card(size: tuple[int, int]) -> None:
    """Baked at margin 1 with radius 0.5; at margin 1.25 the same smoke has radius 0.4, at any size and shape."""
    held = Held(
        [view(0.0), view(45.0, margin=1.25)],
        [blob((80, 80), 0.5, 0.2), np.zeros((2, CHANNELS, *size), np.float32)],
    )
    shown = answered(held, 1, 0)
    assert shown is not None
    expected = blob(size, 0.4, 0.2)
    np.testing.assert_allclose(shown[0, 0], encode_srgb(expected[0, 0]), atol=0.012)
    np.testing.assert_allclose(shown[1, 6], expected[1, 6], atol=0.012)
    assert abs(shown[0, 6] - blob(size, 0.5, 0.2)[0, 6]).max() > 0.015  # not the picture as it was


def test_a_bake_of_the_same_size_is_preferred(rng: np.random.Generator) -> None:
    small, large = (rng.random((n, CHANNELS, s, s), dtype=np.float32) for n, s in ((4, 8), (2, 16)))
    held = Held([[*view(0.0), *view(45.0)], view(0.0)], [small, large])
    shown = answered(held, 0, 1)
    assert shown is not None
    np.testing.assert_allclose(shown[:, 6], small[:2, 6], atol=1e-6)
