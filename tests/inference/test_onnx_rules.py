"""What the files hold by the lists of those who read them, and that a file which breaks a rule is refused."""

from collections.abc import Callable
from pathlib import Path

import onnx
import pytest

from sixway.inference.onnx_rules import Precision, Target, check_rules

# Unity Inference Engine 2.3 docs, Unreal's NNERuntimeRDGHlsl sources and onnxruntime-web's tables, what all three have
ENGINE = {
    *("Conv", "ConvTranspose", "Concat", "Add", "Mul", "Div", "Sub", "Sigmoid", "Relu", "LeakyRelu", "Slice", "Pad"),
    *("InstanceNormalization", "Reshape", "Resize", "Erf", "Clip", "ReduceMean", "GlobalAveragePool", "AveragePool"),
    *("Sqrt", "Pow", "Transpose", "DepthToSpace", "Constant", "Identity"),
}
NEVER = {
    *("Shape", "If", "Loop", "Scan", "GridSample", "GroupNormalization", "NonZero", "Softplus", "ConstantOfShape"),
    *("Expand", "Range"),
}


def opset(model: onnx.ModelProto) -> int:
    assert [entry.domain for entry in model.opset_import] == [""]
    return model.opset_import[0].version


def operators(model: onnx.ModelProto) -> set[str]:
    """Also sees to it that each is defined at the opset that the file names, and has no graph inside."""
    for node in model.graph.node:
        assert node.domain == ""
        onnx.defs.get_schema(node.op_type, max_inclusive_version=opset(model))
        assert not any(attribute.HasField("g") or attribute.graphs for attribute in node.attribute), node.name
    return {node.op_type for node in model.graph.node}


def test_the_file_for_engines_is_plain(exported: Path) -> None:
    model = onnx.load(exported, load_external_data=False)
    assert 7 <= opset(model) <= 15
    found = operators(model)
    assert "Conv" in found and found <= ENGINE
    constants = {node.output[0] for node in model.graph.node if node.op_type == "Constant"}
    constants |= {tensor.name for tensor in model.graph.initializer}
    for node in model.graph.node:
        if node.op_type in ("Slice", "Clip"):  # their ranges must be constants
            assert {name for name in node.input[1:] if name} <= constants, node.name
        if node.op_type == "Conv":
            assert node.input[1] in constants, "weights are computed at run time"
        if node.op_type == "AveragePool":
            assert not {"ceil_mode", "count_include_pad"} & {option.name for option in node.attribute}


def test_the_files_for_onnx_runtime_hold_what_it_has_kernels_for(dynamic_files: dict[Precision, Path]) -> None:
    more = {"fp32": set(), "fp16": {"Cast"}, "int8": {"QuantizeLinear", "DequantizeLinear"}}
    for precision, path in dynamic_files.items():
        model = onnx.load(path, load_external_data=False)
        assert opset(model) >= 18
        found = operators(model)
        assert found <= ENGINE | {"LayerNormalization", "Split"} | more[precision]
        assert more[precision] | {"LayerNormalization", "Conv"} <= found and not NEVER & found
        assert "Sqrt" not in found, "layer norm is spelt out"
        assert not any(tensor.external_data for tensor in model.graph.initializer)
        for value in (*model.graph.input, *model.graph.output):
            sizes = [size.dim_value or size.dim_param for size in value.type.tensor_type.shape.dim]
            assert sizes == ["batch", 8, "4*rows", "4*columns"]  # the stride is 4
            assert value.type.tensor_type.elem_type == onnx.TensorProto.FLOAT


def older_opset(model: onnx.ModelProto) -> None:
    model.opset_import[0].version -= 4


def newer_opset(model: onnx.ModelProto) -> None:
    model.opset_import[0].version += 1


def foreign_domain(model: onnx.ModelProto) -> None:
    model.opset_import.add(domain="com.microsoft", version=1)


def foreign_operator(model: onnx.ModelProto) -> None:
    node = next(node for node in model.graph.node if node.op_type == "LeakyRelu")
    node.op_type = "Elu"


def no_such_operator(model: onnx.ModelProto) -> None:
    model.graph.node[-1].op_type = "Lightmap"


def half_input(model: onnx.ModelProto) -> None:
    model.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.FLOAT16
    cast = onnx.helper.make_node("Cast", ["guide"], ["guide_float"], to=onnx.TensorProto.FLOAT)
    for node in model.graph.node:
        node.input[:] = ["guide_float" if name == "guide" else name for name in node.input]
    model.graph.node.insert(0, cast)


def pool_option(model: onnx.ModelProto) -> None:
    pool = next(node for node in model.graph.node if node.op_type == "AveragePool")
    pool.attribute.append(onnx.helper.make_attribute("count_include_pad", 1))


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (newer_opset, "wrote opsets {'': 16}, wanted 15 alone"),
        (foreign_domain, "wrote opsets .*com.microsoft.*wanted 15 alone"),
        (foreign_operator, r"operators \['Elu'\], which a file for engine may not hold"),
        (no_such_operator, "no valid ONNX .*Lightmap"),
        (pool_option, r"AveragePool has the options \['count_include_pad'\], which engines lack"),
    ],
)
def test_a_file_for_engines_that_breaks_a_rule_is_refused(
    exported: Path, spoil: Callable[[onnx.ModelProto], None], reason: str
) -> None:
    model = onnx.load(exported)
    check_rules(model, target="engine", precision="fp32")
    spoil(model)
    with pytest.raises(RuntimeError, match=rf"{reason}.*it is not written"):
        check_rules(model, target="engine", precision="fp32")


def test_a_half_at_the_door_is_refused(exported: Path) -> None:
    model = onnx.load(exported)
    half_input(model)
    with pytest.raises(RuntimeError, match=r"'guide' should be FLOAT .*but is FLOAT16 .*it is not written"):
        check_rules(model, target="engine", precision="fp16")  # where Cast is known


@pytest.mark.parametrize(
    ("target", "precision", "reason"),
    [
        ("engine", "fp32", "wrote opsets {'': 18}, wanted 15 alone"),
        ("ort", "fp16", None),
    ],
)
def test_a_file_of_another_kind_is_refused(
    dynamic_files: dict[Precision, Path], target: Target, precision: Precision, reason: str | None
) -> None:
    model = onnx.load(dynamic_files["fp32"])
    if reason is None:  # float32 may stand in for less
        check_rules(model, target=target, precision=precision)
        return
    with pytest.raises(RuntimeError, match=reason):
        check_rules(model, target=target, precision=precision)


def test_an_opset_that_a_file_only_claims_is_refused(dynamic_files: dict[Precision, Path]) -> None:
    """LayerNormalization began at 17; the dynamo exporter asked for less writes it with no more than a warning."""
    model = onnx.load(dynamic_files["fp32"])
    older_opset(model)
    assert opset(model) == 14
    with pytest.raises(RuntimeError, match=r"no valid ONNX .*it is not written"):
        check_rules(model, target="ort", precision="fp32")
