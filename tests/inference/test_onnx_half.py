"""Half precision inside, float32 where a half would not do; judged by ONNX's reference, which rounds at every node."""

from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from onnx.reference import ReferenceEvaluator

from sixway.inference.onnx import EngineNet
from sixway.inference.onnx_half import to_half
from sixway.inference.onnx_rules import Precision
from sixway.models.card import load_net


def attention(size: int) -> onnx.ModelProto:
    """The net's shape in small: alpha = 1 - T, a mean over the smoke between two convolutions, alpha added at the end.

    With convolutions that are the identity: alpha * (sum(alpha^2) / sum(alpha)) + alpha.
    """
    one = numpy_helper.from_array(np.ones((1, 1, 1, 1), np.float32), "one")
    nodes = [
        helper.make_node("Sub", ["one", "guide"], ["alpha"]),
        helper.make_node("ReduceMean", ["alpha"], ["mean"], axes=[2, 3], keepdims=1),
        helper.make_node("Div", ["alpha", "mean"], ["share"]),
        helper.make_node("Conv", ["alpha", "first"], ["features"]),
        helper.make_node("Mul", ["features", "share"], ["weighted"]),
        helper.make_node("ReduceMean", ["weighted"], ["over_smoke"], axes=[2, 3], keepdims=1),
        helper.make_node("Mul", ["features", "over_smoke"], ["attended"]),
        helper.make_node("Conv", ["attended", "second"], ["correction"]),
        helper.make_node("Add", ["alpha", "correction"], ["lightmap"]),
    ]
    weights = [numpy_helper.from_array(np.ones((1, 1, 1, 1), np.float32), name) for name in ("first", "second")]
    put, get = (helper.make_tensor_value_info(n, TensorProto.FLOAT, [1, 1, size, size]) for n in ("guide", "lightmap"))
    graph = helper.make_graph(nodes, "attention", [put], [get], [one, *weights])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 15)])


def types(model: onnx.ModelProto) -> dict[str, int]:
    graph = onnx.shape_inference.infer_shapes(model, strict_mode=True).graph
    return {value.name: value.type.tensor_type.elem_type for value in (*graph.value_info, *graph.input, *graph.output)}


def test_what_is_half_and_what_is_not() -> None:
    model = to_half(attention(8))
    onnx.checker.check_model(model, full_check=True)
    found = types(model)
    half = {name for name, kind in found.items() if kind == TensorProto.FLOAT16}
    assert {"features", "attended", "correction"} <= half
    assert not {"guide", "alpha", "mean", "share", "weighted", "over_smoke", "lightmap"} & half
    assert {tensor.data_type for tensor in model.graph.initializer if "one" not in tensor.name} == {TensorProto.FLOAT16}
    names = [cast.output[0] for cast in model.graph.node if cast.op_type == "Cast"]
    assert sorted(names) == ["alpha_half", "correction_float", "features_float", "over_smoke_half"]


def test_a_lone_puff_in_a_large_picture_does_not_overflow() -> None:
    """Its share of smoke is 512^2 = 262144, four times the largest half."""
    guide = np.ones((1, 1, 512, 512), np.float32)
    guide[0, 0, 100, 200] = 0.25
    (answer,) = ReferenceEvaluator(to_half(attention(512))).run(None, {"guide": guide})
    alpha = 1.0 - guide
    np.testing.assert_allclose(answer, alpha * 0.75 + alpha, rtol=1e-3)
    assert answer[0, 0, 100, 200] > 1.3


def test_faint_smoke_is_not_rounded_away() -> None:
    """1 - T of T = 1 - 1e-4 is 0 in halves, whose step below 1 is 5e-4."""
    guide = np.full((1, 1, 8, 8), 1.0 - 1e-4, np.float32)
    (answer,) = ReferenceEvaluator(to_half(attention(8))).run(None, {"guide": guide})
    np.testing.assert_allclose(answer, 1e-4 + 1e-8, rtol=2e-3)


def test_a_converted_copy_leaves_its_source_alone() -> None:
    model = attention(8)
    before = model.SerializeToString()
    to_half(model)
    assert model.SerializeToString() == before


@pytest.mark.parametrize("kind", ["engine", "ort"])
def test_the_net_in_true_halves(
    kind: str, exported: Path, dynamic_files: dict[Precision, Path], trained_run: Path, real_guide: np.ndarray
) -> None:
    """ONNX Runtime computes halves on a CPU in float32: only the reference shows what a GPU would round."""
    model = to_half(onnx.load(exported if kind == "engine" else dynamic_files["fp32"]))
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"]
    weights = {tensor.name: tensor.data_type for tensor in model.graph.initializer}
    assert {weights[name] for node in convolutions for name in node.input[1:]} == {TensorProto.FLOAT16}
    guide = real_guide[:1]
    (answer,) = ReferenceEvaluator(model).run(None, {"guide": guide})
    with torch.inference_mode():
        expected = EngineNet(load_net(trained_run)[0])(torch.from_numpy(guide)).numpy()
    np.testing.assert_allclose(answer, expected, rtol=0.0, atol=5e-3)
    assert answer.dtype == np.float32
