"""Curves written on a command line."""

import pytest

from sixway.inference.remap_notation import parse_remap
from sixway.shading.remap import Contrast, Curve, Remap

NONE = {"low_high": None, "contrast": None, "curve": None, "to": None, "alpha": None}


@pytest.mark.parametrize(
    ("given", "remap"),
    [
        ({"low_high": "0.1:0.9"}, Remap(from_range=(0.1, 0.9))),
        ({"to": "1:0"}, Remap(to_range=(1.0, 0.0))),
        ({"contrast": "-2"}, Remap(shape=Contrast(intensity=-2.0))),
        ({"contrast": "1.5:0.3"}, Remap(shape=Contrast(intensity=1.5, pivot=0.3))),
        ({"curve": "0:0,0.5:1"}, Remap(shape=Curve(points=((0.0, 0.0), (0.5, 1.0))))),
        ({"alpha": "0:0,1:0.5", "to": "0:2"}, Remap(to_range=(0.0, 2.0), alpha=Curve(points=((0.0, 0.0), (1.0, 0.5))))),
        ({}, None),
    ],
)
def test_curves_parse(given: dict[str, str], remap: Remap | None) -> None:
    assert parse_remap(**{**NONE, **given}) == remap


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"low_high": "0.5"}, "--map-range '0.5' is not A:B"),
        ({"low_high": "1:0"}, r"--map-range 1:0: from_range \(1\.0, 0\.0\) must rise"),
        ({"to": "-1:1"}, r"--map-to -1:1: to_range \(-1\.0, 1\.0\) must not be negative"),
        ({"to": "0:inf"}, "--map-to '0:inf' is not A:B"),
        ({"contrast": "much"}, "--map-contrast 'much' is not INTENSITY or INTENSITY:PIVOT"),
        ({"contrast": "9"}, "--map-contrast 9: Input should be less than or equal to 5"),
        ({"contrast": "1:2"}, "--map-contrast 1:2: Input should be less than or equal to 1"),
        ({"contrast": "1", "curve": "0:0,1:1"}, "one shape at a time"),
        ({"curve": "0,1"}, "--map-curve '0,1' is not VALUE:RESULT"),
        ({"curve": "1:0,0:1"}, r"--map-curve 1:0,0:1: curve points at \[1\.0, 0\.0\] must rise"),
        ({"alpha": "0:-1"}, "--alpha-curve 0:-1: .*must not have negative results"),
        ({"alpha": ""}, "--alpha-curve '' is not VALUE:RESULT"),
    ],
)
def test_what_is_no_curve_is_told(given: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_remap(**{**NONE, **given})
