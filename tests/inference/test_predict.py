"""Guide in, lightmap out: torch and ONNX alike, physical values, and nets that are not what they say."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from sixway.core.config import ConfigError
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.frames import Camera
from sixway.core.records import GuideMap
from sixway.core.store import sha256_file
from sixway.inference.bake import LightmapBaker
from sixway.inference.predict import OnnxPredictor, TorchPredictor, load_predictor, predict
from sixway.models.card import CARD, WEIGHTS, NetCard, load_net, save_net
from sixway.volumes.read import read_volume

JET = Path(__file__).parents[1] / "data/jet.npz"


def guide_of(image: np.ndarray, channels: tuple[str, ...]) -> GuideMap:
    return GuideMap(
        channels=channels,
        image=np.ascontiguousarray(np.moveaxis(image, 0, -1)),
        depth_m=np.ones(image.shape[1:], np.float32),
    )


@dataclasses.dataclass
class Says:
    """A net that answers one value a channel, whatever it is asked."""

    card: NetCard
    values: tuple[float, ...]

    def encoded(self, guide: np.ndarray) -> np.ndarray:
        answer = np.array(self.values, np.float32)[None, :, None, None]
        return np.broadcast_to(answer, (len(guide), 8, *guide.shape[2:])).copy()


@pytest.fixture
def own_run(trained_run: Path, tmp_path: Path) -> Path:
    """A copy of the run to spoil."""
    return Path(shutil.copytree(trained_run, tmp_path / "run"))


def change_card(run: Path, **changes: object) -> None:
    card = json.loads((run / CARD).read_text()) | changes
    (run / CARD).write_text(json.dumps(card))


def test_run_folder_and_onnx_file_predict_the_same(
    trained_run: Path, exported: Path, real_guide: np.ndarray, card: NetCard
) -> None:
    by_torch, by_onnx = (load_predictor(path, device="cpu") for path in (trained_run, exported))
    assert isinstance(by_torch, TorchPredictor) and isinstance(by_onnx, OnnxPredictor)
    for picture in real_guide:
        guide = guide_of(picture, card.guide_channels)
        a, b = predict(by_torch, guide), predict(by_onnx, guide)
        assert a.channels == b.channels
        assert a.maps.max() > 0.01
        np.testing.assert_allclose(a.image, b.image, rtol=0.0, atol=1e-4)
    assert by_onnx.encoded(real_guide).shape == (2, 8, 20, 24)


def test_an_exported_net_names_its_one_size(exported: Path) -> None:
    with pytest.raises(ValueError, match=r"net\.onnx: runs at 24 x 20 px only, asked for 32 x 20; export that size"):
        OnnxPredictor(exported, device="cpu").encoded(np.zeros((1, 8, 20, 32), np.float32))


def test_a_net_refuses_another_guide(trained_run: Path, real_guide: np.ndarray, card: NetCard) -> None:
    predictor = load_predictor(trained_run, device="cpu")
    exchanged = (card.guide_channels[1], card.guide_channels[0], *card.guide_channels[2:])
    with pytest.raises(ValueError, match="this net reads the guide"):
        predict(predictor, guide_of(real_guide[0], exchanged))
    with pytest.raises(ValueError, match=r"this net reads the guide.*in_scatter"):
        predict(predictor, guide_of(real_guide[0, :3], ("in_scatter", "transmittance", "depth")))


@pytest.mark.parametrize("emissive", [False, True])
def test_answers_become_physical_light(real_guide: np.ndarray, card: NetCard, emissive: bool) -> None:
    """0.5 in sRGB is 0.21404 linear; a negative answer is no light; alpha is linear and at most 1."""
    card = card.model_copy(update={"scale": 4.0, "has_emissive": emissive})
    values = (0.5, 0.0, -0.3, 1.0, 0.5, 0.5, 1.7, 0.5)
    lightmap = predict(Says(card, values), guide_of(real_guide[0], card.guide_channels))
    assert lightmap.channels == (LIGHTMAP_CHANNELS if emissive else LIGHTMAP_CHANNELS[:-1])
    assert lightmap.image.shape == (20, 24, 8 if emissive else 7)
    expected = {"right": 0.21404 / 4, "left": 0.0, "top": 0.0, "bottom": 0.25, "alpha": 1.0}
    for name, value in expected.items():
        np.testing.assert_allclose(lightmap[name], value, atol=1e-5)
    if emissive:
        np.testing.assert_allclose(lightmap["emissive"], 0.21404 / 4, atol=1e-5)


def test_smoke_becomes_a_lightmap(trained_run: Path) -> None:
    frame = read_volume(JET)
    camera = Camera.around(frame.grid, margin=0.8, width_px=32, height_px=27)
    baker = LightmapBaker(load_predictor(trained_run, device="cpu"), extinction_per_m=30.0, device="cpu")
    lightmap = baker.bake(frame, camera, seed=0)
    assert lightmap.channels == LIGHTMAP_CHANNELS[:-1]
    assert lightmap.image.shape == (27, 32, 7)
    assert 0.0 <= lightmap["alpha"].min() < 0.3 and 0.7 < lightmap["alpha"].max() <= 1.0
    smoke = lightmap["alpha"] > 0.5
    for name in DIRECTIONS:
        assert lightmap[name][smoke].mean() > 3.0 * lightmap[name][lightmap["alpha"] < 0.02].mean()
    np.testing.assert_array_equal(baker.bake(frame, camera, seed=0).image, lightmap.image)


def test_denser_smoke_hides_more(trained_run: Path) -> None:
    frame = read_volume(JET)
    camera = Camera.around(frame.grid, width_px=24, height_px=24)
    predictor = load_predictor(trained_run, device="cpu")
    thin, thick = (
        LightmapBaker(predictor, extinction_per_m=extinction, device="cpu").bake(frame, camera, seed=0)["alpha"]
        for extinction in (5.0, 50.0)
    )
    assert thick.mean() > 1.3 * thin.mean()


def test_weights_of_another_run_are_refused(own_run: Path) -> None:
    net, card = load_net(own_run)
    with torch.no_grad():
        net.adapters[0].head.bias.add_(0.1)  # type: ignore[union-attr]
    save_net(own_run / "other", net, card)
    shutil.copyfile(own_run / "other" / WEIGHTS, own_run / WEIGHTS)
    with pytest.raises(ValueError, match=rf"{WEIGHTS}: is not the file that {CARD} names; copy both from one run"):
        load_predictor(own_run, device="cpu")


@pytest.mark.parametrize("keep", [0.5, 0.01, 0.0])
def test_truncated_weights_are_refused(own_run: Path, keep: float) -> None:
    whole = (own_run / WEIGHTS).read_bytes()
    (own_run / WEIGHTS).write_bytes(whole[: int(len(whole) * keep)])
    with pytest.raises(ValueError, match=f"{WEIGHTS}: is not the file"):
        load_predictor(own_run, device="cpu")
    change_card(own_run, weights_sha256=sha256_file(own_run / WEIGHTS))  # even if the card agrees
    with pytest.raises(ValueError, match=f"{WEIGHTS}: cannot be loaded"):
        load_predictor(own_run, device="cpu")


def test_weights_of_another_shape_are_refused(own_run: Path) -> None:
    change_card(own_run, net={"widths": [8, 16], "adapter_width": 8, "adapter_blocks": 1})
    with pytest.raises(ValueError, match=f"{WEIGHTS}: cannot be loaded"):
        load_predictor(own_run, device="cpu")


@pytest.mark.parametrize(
    ("changes", "place"), [({"format": 2}, "format"), ({"scale": -1.0}, "scale"), ({"steps": "many"}, "steps")]
)
def test_a_card_that_does_not_fit_is_refused(own_run: Path, changes: dict[str, object], place: str) -> None:
    change_card(own_run, **changes)
    with pytest.raises(ValueError, match=rf"{CARD}: {place}: .*no card of a sixway net of format 1"):
        load_predictor(own_run, device="cpu")


def test_a_card_that_is_no_json_is_refused(own_run: Path) -> None:
    (own_run / CARD).write_text('{"format": 1, "net"')
    with pytest.raises(ValueError, match=rf"{CARD}: not valid JSON"):
        load_predictor(own_run, device="cpu")


def test_a_folder_without_a_net_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"holds no trained net.*python -m sixway\.train"):
        load_predictor(tmp_path, device="cpu")


def test_a_guide_or_medium_that_is_unknown_here_is_refused(trained_run: Path, card: NetCard) -> None:
    def baker(**changes: object) -> LightmapBaker:
        told = Says(card.model_copy(update=changes), (0.0,) * 8)
        return LightmapBaker(told, extinction_per_m=1.0, device="cpu")

    with pytest.raises(ConfigError, match=r"the net's guide.*stepz: unknown key"):
        baker(guide={**card.guide, "stepz": 3})
    with pytest.raises(ValueError, match="hg_g"):
        baker(medium={"albedo": 1.0})


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without CUDA")
def test_a_device_that_is_not_there_is_told(trained_run: Path, exported: Path) -> None:
    for path in (trained_run, exported):
        with pytest.raises(ValueError, match="--device cuda: .*cpu"):
            load_predictor(path, device="cuda")
    with pytest.raises(ValueError, match="--device gpu: torch cannot use it"):
        load_predictor(trained_run, device="gpu")
