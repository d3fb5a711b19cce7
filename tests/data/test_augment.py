"""Flips: exact involutions, and true to what a mirrored volume looks like."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.data.augment import flip_flow, flip_image, flip_pair
from sixway.data.clips import Batch
from sixway.guide.march import GuideConfig, GuideMarcher
from sixway.models.flow_lucas_kanade import LucasKanade

SIX = GuideConfig(lights=("right", "left", "top", "bottom", "front", "back"), sum_lights=False, jitter=False)
PAPER = GuideConfig(jitter=False)


def tensor(guide_image: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.moveaxis(guide_image, -1, 0)[None].copy())


@given(height=st.integers(1, 5), width=st.integers(1, 5), horizontal=st.booleans(), vertical=st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_flip_undoes_itself(height: int, width: int, horizontal: bool, vertical: bool) -> None:
    images = torch.rand(2, 8, height, width, generator=torch.Generator().manual_seed(height * 8 + width))
    once = flip_image(images, LIGHTMAP_CHANNELS, horizontal=horizontal, vertical=vertical)
    twice = flip_image(once, LIGHTMAP_CHANNELS, horizontal=horizontal, vertical=vertical)
    assert torch.equal(twice, images)


def test_left_and_right_change_places_and_nothing_else_does() -> None:
    images = torch.rand(1, 8, 3, 4)
    flipped = flip_image(images, LIGHTMAP_CHANNELS, horizontal=True, vertical=False)
    read_from = {"right": "left", "left": "right"}
    for i, name in enumerate(LIGHTMAP_CHANNELS):
        source = LIGHTMAP_CHANNELS.index(read_from.get(name, name))
        assert torch.equal(flipped[0, i], images[0, source].flip(-1)), name


def test_guide_and_target_are_flipped_alike() -> None:
    maps = torch.rand(2, 8, 3, 4)
    order = ("back", "top", "left", "alpha", "right", "bottom", "front", "emissive")
    guide = maps[:, [LIGHTMAP_CHANNELS.index(name) for name in order]]
    pair = flip_pair(Batch(guide=guide, target=maps), order, horizontal=True, vertical=True)
    assert torch.equal(pair.guide, pair.target[:, [LIGHTMAP_CHANNELS.index(name) for name in order]])
    assert not torch.equal(pair.target, maps)


def test_a_channel_without_its_partner_is_an_error() -> None:
    images = torch.rand(1, 2, 3, 4)
    with pytest.raises(ValueError, match=r"cannot be flipped: \['left'\].*switch flips off"):
        flip_image(images, ("right", "transmittance"), horizontal=True, vertical=False)
    flip_image(images, ("right", "transmittance"), horizontal=False, vertical=True)


@pytest.mark.parametrize(("horizontal", "vertical"), [(True, False), (False, True), (True, True)])
def test_the_flow_of_flipped_frames_is_the_flipped_flow(horizontal: bool, vertical: bool) -> None:
    """A blob that goes 1.5 px right and 0.5 px down, seen by an estimator before and after the flip."""
    y, x = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="ij")

    def blob(right: float, down: float) -> torch.Tensor:
        return torch.exp(-((x - 14 - right) ** 2 + (y - 17 - down) ** 2) / 40.0)[None, None]

    estimator = LucasKanade()
    frames = blob(0.0, 0.0), blob(1.5, 0.5)
    axes = [-1] * horizontal + [-2] * vertical
    flow = estimator(*frames)
    assert flow[0, 0, 17, 14] == pytest.approx(1.5, abs=0.2)
    flipped = flip_flow(flow, horizontal=horizontal, vertical=vertical)
    torch.testing.assert_close(flipped, estimator(*(frame.flip(axes) for frame in frames)), rtol=0.0, atol=1e-3)
    pair = Batch(guide=torch.zeros(2, 1, 32, 32), target=torch.zeros(2, 8, 32, 32), flow=flow)
    assert torch.equal(flip_pair(pair, ("depth",), horizontal=horizontal, vertical=vertical).flow, flipped)


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("guide", [SIX, PAPER], ids=["six", "paper"])
@pytest.mark.parametrize("mirrored", ["x", "y"])
def test_a_mirrored_volume_is_marched_to_the_flipped_guide(
    device: str, rng: np.random.Generator, guide: GuideConfig, kind: str, mirrored: str
) -> None:
    density = rng.random((10, 12, 14)).astype(np.float32) ** 3
    grid = Grid.centred(density.shape)
    camera = Camera.around(grid, kind=kind, width_px=22, height_px=18)  # type: ignore[arg-type]
    marcher = GuideMarcher(guide, Medium(extinction_per_m=6.0, hg_g=0.4), device=device)
    axis = {"x": 2, "y": 1}[mirrored]
    plain = marcher.march(DensityFrame(density=density, grid=grid), camera, seed=1)
    other = DensityFrame(density=np.ascontiguousarray(np.flip(density, axis)), grid=grid)
    marched = tensor(marcher.march(other, camera, seed=1).image)
    flipped = flip_image(tensor(plain.image), plain.channels, horizontal=mirrored == "x", vertical=mirrored == "y")
    torch.testing.assert_close(marched, flipped, rtol=1e-3, atol=1e-5)
    # the exchange of channels matters: a mere mirror image is another picture
    if guide is SIX:
        assert (marched - tensor(plain.image).flip(-1 if mirrored == "x" else -2)).abs().max() > 0.01
