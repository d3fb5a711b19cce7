"""Curves over finished maps: their fixed points, and what they leave alone."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from sixway.core.config import ConfigError, load_config
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.records import SixWayLightmap
from sixway.shading.remap import Contrast, Curve, Remap, remap_values, remapped

VALUES = np.linspace(0.0, 1.0, 21)


@pytest.fixture
def lightmap(rng) -> SixWayLightmap:
    image = rng.random((6, 8, len(LIGHTMAP_CHANNELS)), dtype=np.float32)
    image[..., :6] *= image[..., 6:7]
    image[0, 0, :7] = 0.0
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS, image=image)


@pytest.mark.parametrize("remap", [Remap(), Remap(shape=Contrast()), Remap(shape=Curve(), alpha=Curve())])
def test_defaults_change_nothing(lightmap: SixWayLightmap, remap: Remap) -> None:
    np.testing.assert_allclose(remapped(lightmap, remap).image, lightmap.image, atol=1e-6)


@pytest.mark.parametrize("pivot", [0.0, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("intensity", [-5.0, -1.0, 2.0])
def test_contrast_keeps_black_white_and_its_pivot_and_rises(pivot: float, intensity: float) -> None:
    remap = Remap(shape=Contrast(intensity=intensity, pivot=pivot))
    np.testing.assert_allclose(remap_values(np.array([0.0, pivot, 1.0]), remap), [0.0, pivot, 1.0], atol=1e-6)
    assert (np.diff(remap_values(VALUES, remap)) >= 0.0).all()


def test_contrast_is_two_powers() -> None:
    squared = Remap(shape=Contrast(intensity=1.0, pivot=0.4))  # exponent 2
    low, high = remap_values(np.array([0.2, 0.7]), squared)
    assert low == pytest.approx(0.4 * 0.5**2)
    assert high == pytest.approx(1.0 - 0.6 * 0.5**2)
    np.testing.assert_allclose(
        remap_values(1.0 - VALUES, Remap(shape=Contrast(intensity=1.5, pivot=0.6))),
        1.0 - remap_values(VALUES, Remap(shape=Contrast(intensity=1.5, pivot=0.4))),
        atol=1e-12,
    )


def test_ranges_and_curves_apply_in_their_order() -> None:
    remap = Remap(from_range=(0.2, 0.6), shape=Curve(points=((0.0, 0.0), (0.5, 1.0), (1.0, 0.0))), to_range=(0.1, 0.9))
    values = np.array([0.0, 0.2, 0.4, 0.5, 0.6, 3.0])
    np.testing.assert_allclose(remap_values(values, remap), [0.1, 0.1, 0.9, 0.5, 0.1, 0.1])


def test_maps_are_remapped_straight_and_follow_the_new_alpha(lightmap: SixWayLightmap) -> None:
    remap = Remap(shape=Contrast(intensity=1.0, pivot=1.0), alpha=Curve(points=((0.0, 0.0), (1.0, 0.5))))
    result = remapped(lightmap, remap)
    alpha = lightmap["alpha"].astype(float)
    np.testing.assert_allclose(result["alpha"], 0.5 * alpha, rtol=1e-6)
    for name in DIRECTIONS:
        straight = lightmap[name] / np.maximum(alpha, 1e-5)
        np.testing.assert_allclose(result[name], np.minimum(straight, 1.0) ** 2 * 0.5 * alpha, atol=1e-6)
    np.testing.assert_array_equal(result["emissive"], lightmap["emissive"])
    assert not result.image[0, 0, :7].any()  # where there was no smoke there is none


def test_remaps_are_written_in_yaml(tmp_path: Path) -> None:
    path = tmp_path / "look.yaml"
    path.write_text("shape: {kind: contrast, intensity: 1.5}\nto_range: [0, 2]\nalpha: {points: [[0, 0], [1, 0.8]]}\n")
    assert load_config(Remap, path).shape == Contrast(intensity=1.5)
    path.write_text("shape: {kind: contrast, intensity: 6.0}\n")
    with pytest.raises(ConfigError, match="less than or equal to 5"):
        load_config(Remap, path)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"from_range": (0.5, 0.5)}, "must rise"),
        ({"to_range": (-0.5, 0.5)}, "must not be negative"),
        ({"alpha": {"points": ((0.5, 0.0), (0.5, 1.0))}}, "must rise"),
        ({"alpha": {"points": ((0.5, -1.0), (0.6, 1.0))}}, "must not have negative"),
    ],
)
def test_impossible_remaps_are_refused(values, told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        Remap(**values)
