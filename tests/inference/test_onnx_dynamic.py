"""The files for ONNX Runtime: any size, any batch, torch's answers; and eight bits calibrated on real guides."""

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from sixway.inference.onnx import EngineNet, finish_dynamic
from sixway.inference.onnx_file import METADATA_KEY, read_onnx
from sixway.inference.onnx_rules import Precision
from sixway.inference.padding import pad_guide
from sixway.inference.predict import OnnxPredictor
from sixway.models.card import NetCard, load_net

ATOL: dict[Precision, float] = {"fp32": 1e-4, "fp16": 5e-3}


def answer_of_torch(run: Path, guide: np.ndarray) -> np.ndarray:
    with torch.inference_mode():
        answer: np.ndarray = EngineNet(load_net(run)[0])(torch.from_numpy(guide)).numpy()
    return answer


@pytest.mark.parametrize("precision", ["fp32", "fp16"])
@pytest.mark.parametrize(
    "shape", [(2, 20, 24), (1, 4, 4), (3, 36, 16), (2, 21, 30)], ids=["its own", "one stride", "larger", "padded"]
)
def test_every_size_and_batch_answers_as_torch_does(
    dynamic_files: dict[Precision, Path], trained_run: Path, precision: Precision, shape: tuple[int, int, int]
) -> None:
    batch, height, width = shape
    guide = np.random.default_rng(1).random((batch, 8, height, width), dtype=np.float32)
    answer = OnnxPredictor(dynamic_files[precision], device="cpu").encoded(guide)
    assert answer.shape == (batch, 8, height, width)
    np.testing.assert_allclose(answer, answer_of_torch(trained_run, guide), rtol=0.0, atol=ATOL[precision])
    assert answer.std() > 0.01


def test_a_batch_is_its_pictures(dynamic_files: dict[Precision, Path], real_guide: np.ndarray) -> None:
    net = OnnxPredictor(dynamic_files["fp32"], device="cpu")
    one_by_one = np.concatenate([net.encoded(picture[None]) for picture in real_guide])
    np.testing.assert_allclose(net.encoded(real_guide), one_by_one, rtol=0.0, atol=1e-6)
    assert np.abs(one_by_one[0] - one_by_one[1]).max() > 1e-3


def test_its_card_is_the_run_and_says_which_sizes(
    dynamic_files: dict[Precision, Path], card: NetCard, trained_run: Path
) -> None:
    for precision, path in dynamic_files.items():
        assert read_onnx(path)[1] == card
        told = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
        assert json.loads(told[METADATA_KEY])["format"] == 1
        assert (told["target"], told["precision"]) == ("ort", precision)
        assert told["sizes"] == "height and width multiples of 4 px"
        assert str(trained_run) not in str(told) and "site-packages" not in path.read_bytes().decode("latin-1")


def test_eight_bit_convolutions_near_torch(
    dynamic_files: dict[Precision, Path], trained_run: Path, real_guide: np.ndarray
) -> None:
    model = onnx.load(dynamic_files["int8"])
    made_by = {name: node for node in model.graph.node for name in node.output}
    constants = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    assert convolutions
    for node in convolutions:
        features, weights = (made_by[name] for name in node.input[:2])
        assert features.op_type == weights.op_type == "DequantizeLinear", node.name
        eight_bits, scale = (constants[name] for name in weights.input[:2])
        assert eight_bits.dtype == np.int8
        assert scale.shape == eight_bits.shape[:1]  # one a channel
    answer = OnnxPredictor(dynamic_files["int8"], device="cpu").encoded(real_guide)
    apart = answer - answer_of_torch(trained_run, real_guide)
    assert 1e-4 < np.sqrt(np.mean(apart**2)) < 2e-2  # pictures that calibrated nothing


def test_eight_bits_need_pictures(dynamic_files: dict[Precision, Path], trained_run: Path, tmp_path: Path) -> None:
    net, card = load_net(trained_run)
    graph = onnx.load(dynamic_files["fp32"])
    one = np.zeros((1, 8, 20, 24), np.float32)
    with pytest.raises(ValueError, match="int8 takes at least 2 guides to calibrate and to judge with, got 1"):
        finish_dynamic(graph, net, card, tmp_path / "net.onnx", precision="int8", guides=[one])
    assert not list(tmp_path.iterdir())


def test_eight_bits_calibrated_on_the_wrong_pictures_are_not_written(
    dynamic_files: dict[Precision, Path], trained_run: Path, real_guide: np.ndarray, tmp_path: Path
) -> None:
    net, card = load_net(trained_run)
    graph = onnx.load(dynamic_files["fp32"])
    empty = np.zeros((1, 8, 20, 24), np.float32)
    empty[:, card.guide_channels.index("transmittance")] = 1.0
    with pytest.raises(RuntimeError, match=r"differs from torch by .* over .* for int8; it is not written"):
        finish_dynamic(graph, net, card, tmp_path / "net.onnx", precision="int8", guides=[empty, real_guide[:1]])
    assert not list(tmp_path.iterdir())


def test_padding_is_empty_space() -> None:
    guide = np.full((2, 3, 5, 6), 0.5, np.float32)
    padded = pad_guide(guide, ("in_scatter", "transmittance", "depth"), 4)
    assert padded.shape == (2, 3, 8, 8)
    np.testing.assert_array_equal(padded[:, :, :5, :6], guide)
    for beyond in (padded[:, :, 5:], padded[:, :, :, 6:]):
        assert (beyond[:, [0, 2]] == 0.0).all() and (beyond[:, 1] == 1.0).all()
    assert pad_guide(padded, ("in_scatter", "transmittance", "depth"), 4) is padded
