"""Cameras around a simulation: fixed ones as listed, drawn ones in their ranges and kept when more are drawn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sixway.core.config import ConfigError, parse_config
from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.generation.cameras import DrawnViews, FixedViews, views_around

GRID = Grid.centred((8, 8, 8))
DRAWN = DrawnViews(
    drawn=40,
    yaw_deg=(0.0, 90.0),
    pitch_deg=(-25.0, 25.0),
    margin=(0.6, 1.1),
    density_scale=(0.5, 2.0),
    sizes_px=(16, 16, 24),
)


def test_fixed_views_are_every_yaw_with_every_pitch_and_density() -> None:
    fixed = FixedViews(
        yaws_deg=(0.0, 45.0), pitches_deg=(0.0, 20.0), density_scales=(0.5, 1.0), width_px=16, height_px=24
    )
    views = views_around(GRID, [fixed], seed=[1, "jet"])
    assert len({view.name for view in views}) == 8
    view = views[-1]
    assert view.name == "yaw+45_pitch+20_16x24_margin1_density1"
    assert (view.camera.width_px, view.camera.height_px) == (16, 24)


def test_drawn_views_stay_in_their_ranges_and_differ_between_simulations() -> None:
    views = views_around(GRID, [DRAWN], seed=[1, "jet"])
    assert all(0 <= v.yaw_deg <= 90 and -25 <= v.pitch_deg <= 25 and 0.6 <= v.margin <= 1.1 for v in views)
    assert {v.width_px for v in views} == {16, 24} == {v.height_px for v in views}
    scales = np.array([v.density_scale for v in views])
    assert scales.min() >= 0.5 and scales.max() <= 2.0
    # by the logarithm: half of them below 1
    assert 10 <= (scales < 1.0).sum() <= 30
    assert not {v.name for v in views} & {v.name for v in views_around(GRID, [DRAWN], seed=[1, "plume"])}


@given(st.integers(1, 20), st.integers(0, 20))
def test_more_drawn_views_keep_the_earlier_ones(fewer: int, more: int) -> None:
    few, many = (
        views_around(GRID, [DRAWN.model_copy(update={"drawn": n})], seed=[3, "jet"]) for n in (fewer, fewer + more)
    )
    assert many[:fewer] == few


def test_a_view_sees_denser_smoke_and_the_rest_as_it_is() -> None:
    frame = DensityFrame(density=np.full((8, 8, 8), 0.25, np.float32), grid=GRID)
    thin, same = views_around(GRID, [FixedViews(density_scales=(0.5, 1.0))], seed=[1])
    assert np.all(thin.seen(frame).density == 0.125)
    assert same.seen(frame) is frame


def test_all_that_a_picture_depends_on_is_told() -> None:
    (view,) = views_around(GRID, [FixedViews(yaws_deg=(10.0,))], seed=[1])
    assert view.made_by.keys() == {
        "kind", "fov_deg", "yaw_deg", "pitch_deg", "margin", "density_scale", "width_px", "height_px",
    }  # fmt: skip


def test_the_same_camera_twice_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"yaw\+0_pitch\+0_64x64_margin1_density1 would be made twice"):
        views_around(GRID, [FixedViews(), FixedViews()], seed=[1])


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"drawn": 3, "yaw_deg": (90.0, 0.0)}, r"yaw_deg \[90.0, 0.0\] runs backwards"),
        ({"drawn": 3, "pitch_deg": (0.0, 90.0)}, "less than 90"),
        ({"drawn": 0}, "greater than or equal to 1"),
        ({"drawn": 3, "density_scale": (0.0, 1.0)}, "greater than 0"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(values: dict[str, object], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse_config(DrawnViews, values, source="here")
