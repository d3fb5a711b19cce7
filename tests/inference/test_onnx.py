"""The file for engines: what it holds, that it answers as torch does, and what is refused."""

import errno
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.inference.onnx import PARITY, Difference, EngineNet, export_onnx
from sixway.inference.onnx_file import METADATA_KEY, read_onnx
from sixway.inference.predict import OnnxPredictor
from sixway.models.card import NetCard, load_net
from sixway.models.unet import SixWayUNet


def metadata(path: Path) -> dict[str, str]:
    return {entry.key: entry.value for entry in onnx.load(path).metadata_props}


def altered(path: Path, to: Path, change: Callable[[onnx.ModelProto], None]) -> Path:
    model = onnx.load(path)
    change(model)
    to.write_bytes(model.SerializeToString())
    return to


def test_the_file_holds_what_engines_ask_for(exported: Path) -> None:
    model = onnx.load(exported, load_external_data=False)
    constants = [*model.graph.initializer, *(a.t for node in model.graph.node for a in node.attribute)]
    assert not any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in constants)
    assert [path.name for path in exported.parent.iterdir()] == ["net.onnx"]  # no weights beside it, no litter
    for put, name, channels in ((model.graph.input, "guide", 8), (model.graph.output, "lightmap", 8)):
        assert [value.name for value in put] == [name]
        assert put[0].type.tensor_type.elem_type == onnx.TensorProto.FLOAT
        assert [d.dim_value for d in put[0].type.tensor_type.shape.dim] == [1, channels, 20, 24]


def test_the_metadata_says_how_to_use_it(exported: Path, card: NetCard) -> None:
    told = metadata(exported)
    assert told["output_channels"].split(",") == list(LIGHTMAP_CHANNELS)
    assert "sRGB" in told["output"] and "alpha = 1 - T" in told["output"]
    assert "comes FROM" in told["directions"] and "towards the viewer" in told["directions"]
    assert "top" in told["rows"]
    assert (told["target"], told["precision"], told["sizes"]) == ("engine", "fp32", "24 x 20 px")
    own = NetCard.model_validate_json(told[METADATA_KEY])
    assert (own.width_px, own.height_px) == (24, 20)
    assert own == read_onnx(exported)[1]
    assert own.model_copy(update={"width_px": card.width_px, "height_px": card.height_px}) == card
    assert own.scale > 0.0 and len(own.guide_channels) == 8


@pytest.mark.parametrize("size", [(24, 20), (130, 97)], ids=["multiple of the stride", "needs padding"])
def test_onnx_runtime_answers_as_torch_does(trained_run: Path, tmp_path: Path, size: tuple[int, int]) -> None:
    net, card = load_net(trained_run)
    width, height = size
    path = tmp_path / "net.onnx"
    told = export_onnx(net, card, path, width_px=width, height_px=height)
    most = PARITY["fp32"]
    assert 0.0 <= told.rms <= told.largest <= most.largest
    guide = np.random.default_rng(5).random((1, 8, height, width), dtype=np.float32)
    guide[..., ::2] *= 0.1
    (answer,) = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"]).run(None, {"guide": guide})
    with torch.inference_mode():
        raw = net(torch.from_numpy(guide)).numpy()
    expected = np.maximum(raw, 0.0)
    alpha = LIGHTMAP_CHANNELS.index("alpha")
    expected[:, alpha] = np.minimum(expected[:, alpha], 1.0)
    np.testing.assert_allclose(answer, expected, rtol=0.0, atol=most.largest)
    assert answer.std() > 0.01


def test_half_precision_for_engines(trained_run: Path, tmp_path: Path, real_guide: np.ndarray) -> None:
    net, card = load_net(trained_run)
    path = tmp_path / "half.onnx"
    told = export_onnx(net, card, path, width_px=24, height_px=20, precision="fp16")
    assert isinstance(told, Difference) and 1e-6 < told.largest < PARITY["fp16"].largest
    assert metadata(path)["precision"] == "fp16"
    answer = OnnxPredictor(path, device="cpu").encoded(real_guide)
    with torch.inference_mode():
        expected = EngineNet(net)(torch.from_numpy(real_guide)).numpy()
    np.testing.assert_allclose(answer, expected, rtol=0.0, atol=5e-3)


def test_engines_get_no_int8(trained_run: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="engines lack QuantizeLinear.*take fp16, or the target ort"):
        export_onnx(*load_net(trained_run), tmp_path / "net.onnx", width_px=16, height_px=16, precision="int8")
    assert not list(tmp_path.iterdir())


def test_an_export_replaces_the_file_before_it(trained_run: Path, tmp_path: Path) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(b"older")
    net, card = load_net(trained_run)
    export_onnx(net, card, path, width_px=16, height_px=16)
    assert read_onnx(path)[1].width_px == 16
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_keeps_the_file_before_it(
    trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(b"older")

    def full(source: object, target: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("sixway.core.store.os.replace", full)
    net, card = load_net(trained_run)
    with pytest.raises(OSError, match="disk is full"):
        export_onnx(net, card, path, width_px=16, height_px=16)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


class _Foreign(SixWayUNet):
    """Ends in an operator that engines lack."""

    def forward(self, guide: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.softplus(super().forward(guide))


def foreign_operator(net: SixWayUNet) -> SixWayUNet:
    net.__class__ = _Foreign
    return net


def not_a_number(net: SixWayUNet) -> SixWayUNet:
    with torch.no_grad():
        net.adapters[0].head.bias.fill_(float("nan"))  # type: ignore[union-attr]
    return net


@pytest.mark.parametrize(
    ("spoil", "reason"), [(foreign_operator, "Softplus.*not written"), (not_a_number, "differs.*not written")]
)
def test_an_export_that_engines_could_not_run_is_not_written(
    trained_run: Path, tmp_path: Path, spoil: Callable[[SixWayUNet], SixWayUNet], reason: str
) -> None:
    path = tmp_path / "net.onnx"
    path.write_bytes(b"older")
    net, card = load_net(trained_run)
    with pytest.raises(RuntimeError, match=reason):
        export_onnx(spoil(net), card, path, width_px=16, height_px=16)
    assert path.read_bytes() == b"older"
    assert list(tmp_path.iterdir()) == [path]


def test_no_file_and_junk_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.onnx.*python -m sixway\.export"):
        read_onnx(tmp_path / "none.onnx")
    junk = tmp_path / "junk.onnx"
    junk.write_bytes(b"\x89PNG this is no protobuf at all")
    with pytest.raises(ValueError, match=r"junk\.onnx: not a readable ONNX file.*python -m sixway\.export"):
        read_onnx(junk)
    junk.write_bytes(b"")
    with pytest.raises(ValueError, match=r"junk\.onnx.*python -m sixway\.export"):
        read_onnx(junk)


def test_half_a_file_is_refused(exported: Path, tmp_path: Path) -> None:
    path = tmp_path / "half.onnx"
    path.write_bytes(exported.read_bytes()[: exported.stat().st_size // 2])
    with pytest.raises(ValueError, match=r"half\.onnx"):
        OnnxPredictor(path, device="cpu")


def test_a_file_of_someone_else_is_refused(tmp_path: Path) -> None:
    put, get = (onnx.helper.make_tensor_value_info(n, onnx.TensorProto.FLOAT, [1, 8, 20, 24]) for n in ("a", "b"))
    graph = onnx.helper.make_graph([onnx.helper.make_node("Identity", ["a"], ["b"])], "theirs", [put], [get])
    onnx.save(onnx.helper.make_model(graph), tmp_path / "theirs.onnx")
    with pytest.raises(ValueError, match=r"theirs\.onnx: an ONNX file without sixway metadata"):
        read_onnx(tmp_path / "theirs.onnx")


def test_weights_in_another_file_are_refused(exported: Path, tmp_path: Path) -> None:
    path = tmp_path / "outside.onnx"
    onnx.save(onnx.load(exported), path, save_as_external_data=True, location="weights.bin", size_threshold=0)
    with pytest.raises(ValueError, match=r"outside\.onnx: keeps weights in another file, which is refused"):
        read_onnx(path)


def test_weights_in_another_file_are_found_inside_nodes(exported: Path, tmp_path: Path) -> None:
    def hide(model: onnx.ModelProto) -> None:
        tensor = onnx.numpy_helper.from_array(np.ones(3, np.float32))
        tensor.ClearField("raw_data")
        tensor.data_location = onnx.TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="/etc/passwd")
        model.graph.node.append(onnx.helper.make_node("Constant", [], ["hidden"], value=tensor))

    with pytest.raises(ValueError, match="keeps weights in another file"):
        read_onnx(altered(exported, tmp_path / "hidden.onnx", hide))


def test_a_card_of_another_format_is_refused(exported: Path, tmp_path: Path) -> None:
    def newer(model: onnx.ModelProto) -> None:
        entry = next(entry for entry in model.metadata_props if entry.key == METADATA_KEY)
        entry.value = entry.value.replace('"format":1', '"format":2')

    with pytest.raises(ValueError, match=r"newer\.onnx: format:.*no card of a sixway net of format 1"):
        read_onnx(altered(exported, tmp_path / "newer.onnx", newer))


def test_a_card_that_does_not_fit_its_graph_is_refused(exported: Path, tmp_path: Path) -> None:
    def wider(model: onnx.ModelProto) -> None:
        entry = next(entry for entry in model.metadata_props if entry.key == METADATA_KEY)
        entry.value = entry.value.replace('"width_px":24', '"width_px":48')

    path = altered(exported, tmp_path / "wider.onnx", wider)
    assert read_onnx(path)[1].width_px == 48
    with pytest.raises(ValueError, match=r"wider\.onnx.*not what its card says; export the run again"):
        OnnxPredictor(path, device="cpu")


def test_a_graph_that_cannot_run_is_refused(exported: Path, tmp_path: Path) -> None:
    def torn(model: onnx.ModelProto) -> None:
        del model.graph.node[len(model.graph.node) // 2]

    with pytest.raises(ValueError, match=r"torn\.onnx: ONNX Runtime refuses it"):
        OnnxPredictor(altered(exported, tmp_path / "torn.onnx", torn), device="cpu")
