"""Plans of frames, tiles of a grid, borders, straight alpha."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.engines.alpha import to_premultiplied, to_straight
from sixway.engines.flipbook import (
    TileGrid,
    border_ramp,
    decimate,
    every_frame,
    loop,
    parse_grid,
    place,
    retime,
    shown_frame,
    split,
)

CHANNELS = ("right", "left", "top", "bottom", "front", "back", "alpha")


def test_tiles_run_row_by_row_from_the_top_left() -> None:
    grid = TileGrid(3, 2)
    atlas = np.zeros((8, 15, 1), np.float32)
    for i in range(6):
        place(atlas, np.full((4, 5, 1), i, np.float32), i, grid)
    assert atlas[0, ::5, 0].tolist() == [0, 1, 2]
    assert atlas[-1, ::5, 0].tolist() == [3, 4, 5]
    np.testing.assert_array_equal(split(atlas, grid, 6)[:, 0, 0, 0], np.arange(6))


@given(frames=st.integers(1, 300))
def test_auto_grid_holds_all_frames_and_no_empty_row(frames: int) -> None:
    grid = parse_grid("auto", frames)
    assert grid.columns * (grid.rows - 1) < frames <= grid.tiles


@given(count=st.integers(2, 40), data=st.data())
def test_plans_are_averages_and_loops_close(count: int, data: st.DataObject) -> None:
    crossfade = data.draw(st.integers(1, count // 2))
    plan = loop(every_frame(count), crossfade)
    assert len(plan) == count - crossfade
    for frame in retime(plan, data.draw(st.integers(1, 50)), closed=True):
        assert sum(weight for _, weight in frame) == pytest.approx(1.0)
        assert all(0 <= source < count for source, _ in frame)


def test_a_straight_run_of_numbers_shows_each_plan() -> None:
    def shown(plan):
        return [
            float(shown_frame(plan, i, lambda n: np.full((1, 1, 1), n, np.float32))[0, 0, 0]) for i in range(len(plan))
        ]

    assert shown(every_frame(4)) == [0, 1, 2, 3]
    assert shown(decimate(every_frame(7), 3)) == [0, 3, 6]
    assert shown(retime(every_frame(4), 7)) == pytest.approx([0, 0.5, 1, 1.5, 2, 2.5, 3])
    # 6 frames, 2 of them faded: the end (4, 5) runs into the start, and then frames 2 and 3
    assert shown(loop(every_frame(6), 2)) == pytest.approx([4 * 2 / 3 + 0 / 3, 5 / 3 + 1 * 2 / 3, 2, 3])
    assert shown(retime(loop(every_frame(6), 2), 2, closed=True)) == pytest.approx([8 / 3, 2])


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: parse_grid("8by8", 3), "COLUMNSxROWS"),
        (lambda: parse_grid("0x4", 3), "1 to 256"),
        (lambda: TileGrid(3, 2).tile_shape(8, 16), "whole pixels"),
        (lambda: split(np.zeros((4, 4, 1)), TileGrid(2, 2), 5), "do not fit"),
        (lambda: loop(every_frame(4), 3), "1 to 2"),
        (lambda: retime(every_frame(4), 0), "1 or more"),
        (lambda: decimate(every_frame(4), 0), "1 or more"),
        (lambda: border_ramp(8, 8, 4), "narrower"),
    ],
)
def test_misfits_are_refused(call, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        call()


def test_faded_borders_take_nothing_from_the_neighbour() -> None:
    ramp = border_ramp(16, 12, 3)
    assert ramp[0].max() == ramp[:, 0].max() == ramp[-1].max() == ramp[:, -1].max() == 0.0
    assert ramp[3:-3, 3:-3].min() == 1.0
    assert np.all(np.diff(ramp[8, :4]) > 0.0)
    # Bilinear sampling on the seam of two tiles, and the first mip: nothing but black there
    two = np.hstack([ramp, ramp])
    assert (two[:, 11] + two[:, 12]).max() == 0.0


def test_straight_alpha_undoes_and_carries_colours_outwards(rng: np.random.Generator) -> None:
    alpha = np.zeros((17, 13), np.float32)
    alpha[5:12, 4:9] = rng.uniform(0.1, 1.0, (7, 5))
    straight = np.dstack([np.full((17, 13), 0.2 + 0.1 * i, np.float32) for i in range(6)])
    image = np.dstack([straight * alpha[..., None], alpha])
    got = to_straight(image, CHANNELS)
    np.testing.assert_allclose(got[..., :6], straight, atol=1e-5)  # also outside: the edge is dilated
    np.testing.assert_array_equal(got[..., 6], alpha)
    np.testing.assert_allclose(to_premultiplied(got, CHANNELS), image, atol=1e-6)
    with pytest.raises(ValueError, match="needs a channel 'alpha'"):
        to_straight(image[..., :6], CHANNELS[:6])
