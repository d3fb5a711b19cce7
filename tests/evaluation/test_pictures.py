"""The contact sheet: every tile where its label says, none of them turned or mirrored."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.evaluation.lights import PICTURE_LIGHTS, SCORE_LIGHTS
from sixway.evaluation.pictures import contact_sheet, light_sheet

GUIDE = (*DIRECTIONS, "transmittance", "depth")
TILE, ROW, COLUMN, TOP, LEFT = 160, 196, 164, 36, 4
"""Edge of a tile and where tiles stand [px]: rows have a title and labels above their tiles."""

ROWS = ("guide", "predicted", "truth", "flip", "relit predicted", "relit truth")


def ball(height: int, width: int) -> np.ndarray:
    """Encoded lightmaps [8, h, w] of a disc that each light brightens on its own side."""
    v, u = np.mgrid[1 : -1 : height * 1j, -1 : 1 : width * 1j].astype(np.float32)
    alpha = (u * u + v * v < 0.8).astype(np.float32)
    sides = {"right": u, "left": -u, "top": v, "bottom": -v, "front": np.ones_like(u), "back": 0 * u}
    maps = [alpha * (0.1 + 0.8 * np.clip(sides[name], 0.0, 1.0)) for name in DIRECTIONS]
    return np.stack([*maps, alpha, 0 * alpha]).astype(np.float32)


def sheet_of(path: Path, predicted: np.ndarray, truth: np.ndarray) -> np.ndarray:
    guide = np.concatenate([np.zeros_like(truth[:6]), 1.0 - truth[6:7], 0.5 * truth[6:7]])
    guide[0] = 0.5  # light in the channel of the right, nowhere else
    contact_sheet(path / "sheet.png", guide=guide, guide_channels=GUIDE, scale=1.0, predicted=predicted, truth=truth)
    with Image.open(path / "sheet.png") as image:
        assert image.format == "PNG"
        return np.asarray(image).astype(float)


def tile(sheet: np.ndarray, row: str, column: int, height: int = TILE) -> np.ndarray:
    top, left = ROWS.index(row) * ROW + TOP, column * COLUMN + LEFT
    return sheet[top : top + height, left : left + TILE]


def sides(picture: np.ndarray) -> dict[str, float]:
    """Mean brightness of each half, [0, 255]."""
    rows, columns = picture.shape[0] // 2, picture.shape[1] // 2
    return {
        "right": picture[:, columns:].mean(),
        "left": picture[:, :columns].mean(),
        "top": picture[:rows].mean(),
        "bottom": picture[rows:].mean(),
    }


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """The prediction lacks the left map and is right in all else."""
    truth = ball(40, 40)
    predicted = truth.copy()
    predicted[DIRECTIONS.index("left")] = 0.0
    return sheet_of(tmp_path_factory.mktemp("sheet"), predicted, truth)


def test_the_sheet_holds_six_rows_of_up_to_eight_tiles(sheet: np.ndarray) -> None:
    assert sheet.shape == (6 * ROW + 4, 8 * COLUMN + 4, 3)


@pytest.mark.parametrize("name", ["right", "left", "top", "bottom"])
def test_maps_stand_in_their_columns_upright(sheet: np.ndarray, name: str) -> None:
    seen = sides(tile(sheet, "truth", DIRECTIONS.index(name)))
    assert max(seen, key=lambda side: seen[side]) == name
    opposite = {"right": "left", "left": "right", "top": "bottom", "bottom": "top"}[name]
    assert seen[name] > 1.8 * seen[opposite]


def test_the_guide_stands_in_the_first_row(sheet: np.ndarray) -> None:
    lit, dark = tile(sheet, "guide", GUIDE.index("right")), tile(sheet, "guide", GUIDE.index("left"))
    np.testing.assert_allclose(lit, 188.0, atol=1.0)  # 0.5 linear in sRGB
    assert dark.max() == 0.0
    transmittance, depth = (tile(sheet, "guide", GUIDE.index(name)) for name in ("transmittance", "depth"))
    assert transmittance[80, 80, 0] == 0.0 and transmittance[2, 2, 0] == 255.0
    assert depth[80, 80, 0] == 128.0 and depth[2, 2, 0] == 0.0  # not taken for light


def test_flip_is_black_where_maps_are_equal(sheet: np.ndarray) -> None:
    for column, name in enumerate(LIGHTMAP_CHANNELS[:7]):
        error = tile(sheet, "flip", column)
        assert (error.max() < 8.0) == (name != "left"), name
    assert tile(sheet, "predicted", DIRECTIONS.index("left")).max() == 0.0
    assert tile(sheet, "flip", DIRECTIONS.index("left")).max() > 100.0


def test_lit_smoke_is_bright_towards_its_lights(sheet: np.ndarray) -> None:
    names = list(PICTURE_LIGHTS)
    sun = sides(tile(sheet, "relit truth", names.index("sun from the right")))
    assert sun["right"] > 1.3 * sun["left"]
    moon = sides(tile(sheet, "relit truth", names.index("moon from the top left")))
    assert moon["left"] > moon["right"] and moon["top"] > moon["bottom"]
    two = tile(sheet, "relit truth", names.index("red below, blue above"))
    upper, lower = two[40, 80], two[120, 80]
    assert upper[2] > upper[0] and lower[0] > lower[2]
    corner = tile(sheet, "relit truth", 0)[1, 1]
    np.testing.assert_allclose(corner, (63, 79, 101), atol=2)  # the sky, in sRGB
    same = tile(sheet, "relit predicted", names.index("sun from the right"))
    np.testing.assert_array_equal(same, tile(sheet, "relit truth", names.index("sun from the right")))
    without_left = tile(sheet, "relit predicted", names.index("moon from the top left"))
    assert without_left.mean() < tile(sheet, "relit truth", names.index("moon from the top left")).mean() - 3.0


def test_pictures_keep_their_shape(tmp_path: Path) -> None:
    """Twice as wide as high: tiles of 160 x 80, paper below."""
    wide = ball(20, 40)
    sheet = sheet_of(tmp_path, wide, wide)
    assert tile(sheet, "guide", 0, height=80).min() == 188.0
    np.testing.assert_array_equal(sheet[TOP + 80 + 2, LEFT + 80], (24, 26, 30))


def test_pictures_larger_than_a_tile_are_reduced(tmp_path: Path) -> None:
    large = ball(200, 200)
    sheet = sheet_of(tmp_path, large, large)
    seen = sides(tile(sheet, "truth", 0))
    assert seen["right"] > 1.8 * seen["left"]


def test_fire_has_a_column_where_there_is_any(tmp_path: Path) -> None:
    truth = ball(40, 40)
    burning = truth.copy()
    burning[LIGHTMAP_CHANNELS.index("emissive")] = 0.5
    guide = np.zeros((8, 40, 40), np.float32)
    path = tmp_path / "fire.png"
    contact_sheet(path, guide=guide, guide_channels=GUIDE, scale=1.0, predicted=truth, truth=burning, has_emissive=True)
    with Image.open(path) as image:
        sheet = np.asarray(image).astype(float)
    assert tile(sheet, "predicted", 7).max() == 0.0
    np.testing.assert_allclose(tile(sheet, "truth", 7), 128.0)
    assert tile(sheet, "flip", 7).min() > 50.0


def test_the_light_sheet_shows_every_light_of_the_scores(tmp_path: Path) -> None:
    """Each tile is brighter on the side that its light stands on; where nothing differs FLIP is black."""
    truth = ball(40, 40)
    light_sheet(tmp_path / "lights.png", predicted=truth, truth=truth)
    with Image.open(tmp_path / "lights.png") as image:
        sheet = np.asarray(image).astype(float)
    edge, row, column = 96, 96 + 36, 100
    assert sheet.shape == (3 * row + 4, 16 * column + 4, 3)
    for number, light in enumerate(SCORE_LIGHTS):
        left = number * column + LEFT
        seen = sides(sheet[TOP : TOP + edge, left : left + edge])
        x, y, _ = light.to_light
        if abs(x) > 0.3:
            assert (seen["right"] > seen["left"]) == (x > 0.0), number
        if abs(y) > 0.3:
            assert (seen["top"] > seen["bottom"]) == (y > 0.0), number
        assert sheet[TOP + 2 * row : TOP + 2 * row + edge, left : left + edge].max() < 8.0
