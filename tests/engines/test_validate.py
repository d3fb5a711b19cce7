"""The validator names packings and faults of textures made from a bake that it was not tuned on."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from sixway.bake import main as bake
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr
from sixway.core.png import to_8bit
from sixway.engines.alpha import to_straight
from sixway.engines.axis_ball import axis_ball
from sixway.engines.diagnosis import NO_SMOKE, Pictures, Suspicion, diagnose, named, opaque
from sixway.engines.evidence import layout, rim, tone
from sixway.engines.faults import HEALTHY, Fault, curve, damaged, faults_of, healthy, suppose
from sixway.engines.packing import PACKINGS, Packing
from sixway.engines.validate import load_pictures, main, remedy

JET = Path(__file__).parents[1] / "data/jet.npz"
CHANNELS = LIGHTMAP_CHANNELS[:7]


@pytest.fixture(scope="session")
def smoke(tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """The six maps and alpha of a small jet, 64 x 64."""
    out = tmp_path_factory.mktemp("maps")
    assert bake([str(JET), "--out", str(out), "--resolution", "64", "--samples", "2"]) == 0
    return read_exr(out / "frame_0000.exr", CHANNELS)


def stored(image: np.ndarray, packing: Packing, fault: Fault) -> list[np.ndarray]:
    """The 8-bit files of a fault."""
    hypothesis = suppose(healthy(packing, floats=False), fault)
    source = to_straight(image, CHANNELS) if hypothesis.straight else image
    return [to_8bit(picture) for picture in damaged(source, CHANNELS, hypothesis)]


def judged(image: np.ndarray, packing: Packing, fault: Fault, *, told: bool = False) -> Suspicion:
    textures = tuple(opaque(p.astype(np.float32)[None] / 255.0) for p in stored(image, packing, fault))
    packings = (packing,) if told else tuple(PACKINGS.values())
    if packing.stacked:
        return diagnose(Pictures((np.concatenate(textures, axis=1),)), packings, stacked=Pictures(textures))[0]
    return diagnose(Pictures(textures), packings)[0]


@pytest.mark.parametrize("name", PACKINGS)
def test_healthy_packings_are_told_apart(name: str, smoke: np.ndarray) -> None:
    top = judged(smoke, PACKINGS[name], HEALTHY)
    assert (top.packing, top.fault) == (name, HEALTHY) and top.confidence > 0.5


@pytest.mark.parametrize("name", ["unity", "o3de_tlrb"])
def test_single_faults_are_named(name: str, smoke: np.ndarray) -> None:
    packing = PACKINGS[name]
    faults = list(faults_of(packing))[:: 2 if name == "unity" else 5]
    wrong = [fault for fault in faults if (name, fault) not in judged(smoke, packing, fault, told=True).members]
    assert len(wrong) <= 0.05 * len(faults), [str(fault) for fault in wrong]


def test_faults_that_look_the_same_are_one_class(smoke: np.ndarray) -> None:
    top = judged(smoke, PACKINGS["unity"], Fault("mirrored left-right"), told=True)
    assert {fault for _, fault in top.members} == {Fault("mirrored left-right"), Fault("swapped", ("right", "left"))}
    # EmberGen 1.0.5 wrote T and R exchanged: the order of rlt_bbf, whose alpha lies elsewhere
    top = judged(smoke, PACKINGS["embergen_tlr_bbf"], Fault("swapped", ("top", "right")))
    assert ("embergen_tlr_bbf", Fault("swapped", ("top", "right"))) in top.members


def test_more_than_one_fault_is_not_forced_into_one(smoke: np.ndarray) -> None:
    order = ("left", "top", "right", "back", "bottom", "front")
    moved = smoke.copy()
    moved[..., :6] = smoke[..., [DIRECTIONS.index(name) for name in order]]
    top = judged(moved, PACKINGS["godot_tea"], HEALTHY, told=True)
    assert top.fault.kind == "rearranged"
    held = dict(zip(DIRECTIONS, order, strict=True))
    assert top.fault.names == tuple(held[name] for name in ("right", "top", "back", "left", "bottom", "front"))
    assert "more than one" in remedy(top.fault)


def test_pictures_without_smoke_get_no_verdict(rng: np.random.Generator) -> None:
    """Six maps of the same noise hold no direction: nothing may be claimed with confidence."""
    noise = rng.uniform(0.2, 0.8, (1, 32, 32, 1)).astype(np.float32)
    textures = (noise.repeat(4, axis=-1), noise.repeat(4, axis=-1))
    assert named(diagnose(Pictures(textures)), least=0.9) is None


@pytest.mark.parametrize(
    ("told", "coarse_px"), [(None, 0), ("unity", 0), ("unity", 4), ("embergen_tlrb", 0), ("paradox_stacked", 0)]
)
def test_noise_gets_no_verdict(told: str | None, coarse_px: int, rng: np.random.Generator) -> None:
    """Eight pictures of noise that have nothing to do with one another, fine or blurred, look like no smoke."""
    packing = PACKINGS[told or "unity"]
    counts = [len(texture.channels) for texture in packing.textures]
    planes = gaussian_filter(rng.uniform(size=(1, 64, 64, sum(counts))), (0, coarse_px, coarse_px, 0))
    planes = (planes - planes.min()) / np.ptp(planes)
    textures = tuple(opaque(part) for part in np.split(planes, np.cumsum(counts)[:-1], axis=-1))
    pictures = Pictures((np.concatenate(textures, axis=1),) if packing.stacked else textures)
    stacked = Pictures(textures) if packing.stacked else None
    suspicions = diagnose(pictures, (packing,) if told else tuple(PACKINGS.values()), stacked=stacked)
    assert suspicions[0].members == (NO_SMOKE,) and suspicions[0].confidence > 0.9
    assert named(suspicions, least=0.0) is None


def test_shares_of_a_ball_point_at_their_lights() -> None:
    ball = axis_ball(64)[None, ..., :6].astype(np.float64)
    rows = dict(zip(DIRECTIONS, layout(ball), strict=True))
    for name, (axis, sign) in {"right": (0, 1), "left": (0, -1), "top": (1, 1), "bottom": (1, -1)}.items():
        assert sign * rows[name][axis] > 0.8 and sign * rows[name][axis + 2] > 0.1
        assert abs(rows[name][1 - axis]) < 0.05
    # Mirrored pictures change the sign of x and nothing else
    mirrored = dict(zip(DIRECTIONS, layout(ball[:, :, ::-1]), strict=True))
    np.testing.assert_allclose(mirrored["right"], rows["right"] * [-1, 1, -1, 1, 1, 1, 1], atol=1e-9)


@pytest.mark.parametrize("power", [0.5, 1.0, 2.0])
def test_tone_reads_the_power_of_alpha(power: float) -> None:
    alpha = np.linspace(0.0, 1.0, 4096).reshape(1, 64, 64)
    maps = np.repeat((0.25 * alpha**power)[..., None], 6, axis=-1)
    low, middle, size, agreement = tone(maps, alpha)
    assert low == pytest.approx(power, abs=1e-6) and middle == pytest.approx(power, abs=1e-6)
    assert size == pytest.approx(np.log(1.5 * 2.0 / (power + 1.0)), abs=0.01)
    assert agreement == pytest.approx(np.arctanh(0.99))


def test_rim_sees_maps_that_do_not_fade() -> None:
    fading = axis_ball(32)[None, ..., :6].astype(np.float64)
    assert rim(fading) == 0.0 and rim(np.ones_like(fading)) == 1.0


def test_curve_is_its_own_inverse() -> None:
    value = np.linspace(0.0, 1.0, 33)
    for times in (1, 2):
        np.testing.assert_allclose(curve(curve(value, times), -times), value, atol=1e-6)


def test_every_fault_predicts_and_has_a_remedy() -> None:
    for packing in PACKINGS.values():
        base = healthy(packing, floats=False)
        for fault in faults_of(packing):
            other = suppose(base, fault)
            assert other.fault == fault and (other.textures, other.straight) != (base.textures, False)
            assert remedy(fault) != "none needed"
    with pytest.raises(ValueError, match="unknown fault"):
        suppose(base, Fault("upside out"))


def test_command_judges_files(smoke: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    packing = PACKINGS["unity"]

    def save(fault: Fault) -> list[str]:
        paths = [str(tmp_path / f"{texture.suffix}.png") for texture in packing.textures]
        for path, pixels in zip(paths, stored(smoke, packing, fault), strict=True):
            Image.fromarray(np.tile(pixels, (2, 3, 1))).save(path)  # a flipbook of 3 x 2 tiles
        return paths

    assert main([*save(HEALTHY), "--grid", "3x2"]) == 0
    assert "healthy: packing unity" in capsys.readouterr().out
    verdict = tmp_path / "verdict.json"
    paths = save(Fault("swapped", ("right", "top")))
    assert main([*paths, "--packing", "unity", "--grid", "3x2", "--json", str(verdict)]) == 1
    said = capsys.readouterr().out
    assert "fault: swapped right/top" in said and "remedy: exchange" in said and "cannot be told" in said
    assert json.loads(verdict.read_text())["verdict"]["members"][0] == {
        "packing": "unity",
        "fault": "swapped right/top",
    }
    assert main([*paths, "--grid", "5x2"]) == 2
    assert "whole pixels" in capsys.readouterr().err
    for path in paths:
        noise = np.random.default_rng(len(path)).integers(0, 256, (64, 64, 4), np.uint8)
        Image.fromarray(noise).save(path)
    assert main([*paths, "--packing", "unity", "--json", str(verdict)]) == 1
    assert "undecidable: these do not look like six-way maps" in capsys.readouterr().out
    assert json.loads(verdict.read_text())["verdict"] is None
    Image.fromarray(np.zeros((8, 8, 4), np.uint8)).save(paths[1])
    assert main(paths) == 2
    assert "differ in size" in capsys.readouterr().err


def test_real_textures_of_another_project(real_volumes: Path) -> None:
    """An analytic ball before a wall, packed R, L, T / Bottom, Back, Front, with no alpha."""
    folder = real_volumes / "peeweek_sphere"
    if not folder.is_dir():
        pytest.skip("no peeweek_sphere beside the real volumes")
    files = [folder / "Sphere_RLT.png", folder / "Sphere_BBF.png"]
    top = diagnose(load_pictures(files))[0]
    assert ("rlt_bbf", HEALTHY) in top.members and top.confidence > 0.9
    swapped = diagnose(load_pictures(files[::-1]))[0]
    assert ("rlt_bbf", Fault("textures swapped")) in swapped.members
    as_unity = diagnose(load_pictures(files), (PACKINGS["unity"],))[0]
    assert as_unity.fault.names[:6] == ("right", "left", "top", "bottom", "back", "front")
