"""Every packing gives back what it carries, every map sits where it belongs, and the curves are told apart."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sixway.core.color import encode_srgb
from sixway.core.config import load_config
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.engines.axis_ball import axis_ball
from sixway.engines.packing import (
    NEUTRAL,
    PACKINGS,
    Packing,
    PackingConfig,
    Texture,
    decode,
    encode,
    pack,
    packing_from_config,
    parse_packing,
    unpack,
)

FRAMES = arrays(np.float32, (3, 5, 8), elements=st.floats(0, 1, width=16))


@pytest.mark.parametrize("packing", PACKINGS.values(), ids=lambda p: p.name)
@given(image=FRAMES)
@settings(max_examples=10, deadline=None)
def test_packing_returns_the_channels_it_carries(packing: Packing, image: np.ndarray) -> None:
    back, names = unpack(pack(image, LIGHTMAP_CHANNELS, packing), packing)
    for name in set(names) & set(LIGHTMAP_CHANNELS):
        np.testing.assert_array_equal(back[..., names.index(name)], image[..., LIGHTMAP_CHANNELS.index(name)])
    assert set(names) == set(packing.carried)


@pytest.mark.parametrize("packing", PACKINGS.values(), ids=lambda p: p.name)
@given(image=FRAMES)
@settings(max_examples=10, deadline=None)
def test_8bit_codes_return_within_half_a_step(packing: Packing, image: np.ndarray) -> None:
    for picture, texture in zip(pack(image, LIGHTMAP_CHANNELS, packing), packing.textures, strict=True):
        coded = np.rint(encode(picture, texture) * 255.0) / 255.0
        again = encode(decode(coded, texture), texture)
        np.testing.assert_allclose(again, coded, atol=2e-6)
        assert np.abs(coded - encode(picture, texture)).max() <= 0.5 / 255.0 + 1e-6


def test_alpha_channel_is_linear_while_colour_is_srgb() -> None:
    half = np.full((1, 1, 4), 0.5, np.float32)
    unity, unreal = PACKINGS["unity"].textures[0], PACKINGS["unreal_4way"].textures[1]
    bent = float(encode_srgb(np.float32(0.5)))
    np.testing.assert_allclose(encode(half, unity)[0, 0], [bent, bent, bent, 0.5], atol=1e-6)
    np.testing.assert_allclose(encode(half, unreal)[0, 0], [0.5] * 4, atol=1e-6)


PLACES = {
    "unity": ("right top back alpha", "left bottom front emissive"),
    "o3de_tlrb": ("top left right bottom", "front back zero one", "alpha"),
    "o3de_rlt": ("right left top one", "bottom back front one", "alpha"),
    "embergen_tlrb": ("top left right bottom", "emissive emissive emissive alpha"),
    "embergen_tlr_bbf": ("top left right alpha", "bottom back front emissive"),
    "godot_tea": ("right top back", "left bottom front", "alpha emissive occlusion"),
    "paradox_stacked": ("right top back alpha", "left bottom front emissive"),
    "unreal_4way": ("motion_x motion_y emissive alpha", "top left right bottom"),
    "rlt_bbf": ("right left top", "bottom back front", "one one one alpha"),
}


def brightest(plane: np.ndarray) -> tuple[float, float]:
    """Where the light of a picture is, in (x right, y up) from its centre, each in [-1, 1]."""
    y, x = np.mgrid[: plane.shape[0], : plane.shape[1]]
    centre = (plane.shape[1] - 1) / 2
    return float((plane * (x - centre)).sum() / plane.sum() / centre), float(
        -(plane * (y - centre)).sum() / plane.sum() / centre
    )


def looks_like(plane: np.ndarray) -> str:
    """The name of an axis ball's channel, told from its pixels alone."""
    if np.ptp(plane) == 0.0:
        return {0.0: "zero", 1.0: "one"}.get(float(plane[0, 0]), "neutral")
    x, y = brightest(plane)
    if max(abs(x), abs(y)) > 0.2 and abs(abs(x) - abs(y)) > 0.1:
        return ("right" if x > 0 else "left") if abs(x) > abs(y) else ("top" if y > 0 else "bottom")
    if x > 0.2 and y > 0.2:
        return "emissive"
    middle, rim = plane[31, 31], plane[31, 8]
    return "back" if rim > middle else ("front" if middle - rim > 0.3 else "alpha")


@pytest.mark.parametrize("name", PACKINGS)
def test_axis_ball_shows_every_channel_in_its_place(name: str) -> None:
    assert set(PLACES) == set(PACKINGS)
    pictures = pack(axis_ball(64), LIGHTMAP_CHANNELS, PACKINGS[name])
    assert len(pictures) == len(PLACES[name])
    for picture, expected in zip(pictures, PLACES[name], strict=True):
        seen = [looks_like(picture[..., i]) for i in range(picture.shape[-1])]
        wanted = ["neutral" if n.startswith("motion") else "one" if n == "occlusion" else n for n in expected.split()]
        assert seen == wanted


def test_axis_ball_is_lambertian_and_premultiplied() -> None:
    ball = axis_ball(65)
    maps = {name: ball[..., i] for i, name in enumerate(LIGHTMAP_CHANNELS)}
    assert maps["front"][32, 32] == pytest.approx(1.0)
    assert maps["right"][32, 32] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_array_equal(maps["right"], maps["left"][:, ::-1])
    np.testing.assert_array_equal(maps["top"], maps["bottom"][::-1])
    np.testing.assert_allclose(maps["right"], maps["top"].T[::-1, ::-1], atol=1e-6)
    side = np.sqrt(sum(maps[n] ** 2 for n in ("right", "left", "top", "bottom", "front")))
    np.testing.assert_allclose(side, maps["alpha"], atol=1e-5)  # n is a unit vector
    assert all(np.all(maps[name] <= maps["alpha"] + 1e-6) for name in DIRECTIONS)
    with pytest.raises(ValueError, match="needs 8 px"):
        axis_ball(4)


def test_free_mappings_from_text_and_yaml_agree(tmp_path) -> None:
    text = parse_packing("RTB=r,t,bk,a TEA:linear=alpha,e,ao")
    assert [t.channels for t in text.textures] == [
        ("right", "top", "back", "alpha"),
        ("alpha", "emissive", "occlusion"),
    ]
    assert [t.rgb for t in text.textures] == ["srgb", "linear"]
    path = tmp_path / "mine.yaml"
    path.write_text(
        "textures:\n  RTB: {channels: [r, t, bk, a]}\n  TEA: {channels: [alpha, e, ao], rgb: linear}\n",
        encoding="utf-8",
    )
    assert packing_from_config(load_config(PackingConfig, path), name="free").textures == text.textures
    assert parse_packing("unity") is PACKINGS["unity"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("unitee", "take one of unity"),
        ("RTB=right,upper,back", "'upper' is not known"),
        ("RT=right,top", "holds 1, 3 or 4"),
        ("../x=right,top,back", "suffix"),
        ("A:gamma=right,top,back", "must be srgb or linear"),
        ("A=right,top,back A=left,bottom,front", "twice"),
    ],
)
def test_bad_packings_say_what_is_wrong(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_packing(text)


def test_missing_channels_are_neutral_or_refused() -> None:
    image = np.ones((2, 2, 7), np.float32)
    pictures = pack(image, LIGHTMAP_CHANNELS[:-1], PACKINGS["godot_tea"])
    assert pictures[2][0, 0].tolist() == [1.0, NEUTRAL["emissive"], NEUTRAL["occlusion"]]
    with pytest.raises(ValueError, match="needs \\['back'\\]"):
        pack(image[..., :5], ("right", "left", "top", "bottom", "front"), PACKINGS["o3de_tlrb"].__class__(
            name="x", textures=(Texture(suffix="A", channels=("right", "top", "back")),), source="test"))  # fmt: skip
