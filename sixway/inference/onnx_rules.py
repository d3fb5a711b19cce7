"""What an exported file may hold, by who is to read it.

`engine`: Unity's Inference Engine up to 2.5 and Unreal's NNE read opsets 7 to 15, static shapes and a short list of
operators. `ort`: ONNX Runtime, also in browsers and under TensorRT, reads what is newer; sizes are free there.
A browser cannot fetch weights from a second file, so neither has any outside.
"""

from collections.abc import Iterator
from typing import Literal

import onnx

Target = Literal["engine", "ort"]
Precision = Literal["fp32", "fp16", "int8"]

OPSETS: dict[Target, int] = {"engine": 15, "ort": 18}

PLAIN_OPERATORS = frozenset(
    "Add AveragePool Clip Concat Constant Conv DepthToSpace Div GlobalAveragePool Identity LeakyRelu Mul Pow "
    "ReduceMean Relu Sigmoid Slice Sqrt Sub".split()
)
"""Operators that Unity, Unreal, onnxruntime-web and TensorRT all run."""

LACKING_POOL_OPTIONS = frozenset({"ceil_mode", "count_include_pad"})
"""Of AveragePool, in Unity."""

_MORE_BY_TARGET = {"engine": frozenset[str](), "ort": frozenset({"LayerNormalization", "Split", "Transpose"})}
_MORE_BY_PRECISION = {
    "fp32": frozenset[str](),
    "fp16": frozenset({"Cast"}),
    "int8": frozenset({"QuantizeLinear", "DequantizeLinear"}),
}
_FREE_DIMENSIONS: dict[Target, tuple[int, ...]] = {"engine": (), "ort": (0, 2, 3)}


def operators_of(target: Target, precision: Precision) -> frozenset[str]:
    """All that a file of this kind may hold."""
    return PLAIN_OPERATORS | _MORE_BY_TARGET[target] | _MORE_BY_PRECISION[precision]


def check_rules(model: onnx.ModelProto, *, target: Target, precision: Precision) -> None:
    """Raises RuntimeError naming the rule of this target that the file itself breaks, whatever its exporter claims."""
    refused = "it is not written"
    try:
        onnx.checker.check_model(model, full_check=True)  # every operator as of the opset that the file names
    except Exception as error:  # the checker and shape inference raise classes of their own
        reason = " ".join(str(error).split())
        raise RuntimeError(f"the exporter wrote a file that is no valid ONNX ({reason}); {refused}") from error
    opsets = {entry.domain: entry.version for entry in model.opset_import}
    if opsets != {"": OPSETS[target]}:
        raise RuntimeError(f"the exporter wrote opsets {opsets}, wanted {OPSETS[target]} alone; {refused}")
    strange = {node.op_type for node in model.graph.node} - operators_of(target, precision)
    if strange:
        raise RuntimeError(
            f"the net exports to operators {sorted(strange)}, which a file for {target} may not hold; {refused}"
        )
    pools = [node for node in model.graph.node if node.op_type == "AveragePool"]
    lacking = {option.name for pool in pools for option in pool.attribute} & LACKING_POOL_OPTIONS
    if target == "engine" and lacking:
        raise RuntimeError(f"AveragePool has the options {sorted(lacking)}, which engines lack; {refused}")
    if any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in tensors(model.graph)):
        raise RuntimeError(f"the exporter put weights into another file; {refused}")
    for value in (*model.graph.input, *model.graph.output):
        _check_door(value, free=_FREE_DIMENSIONS[target])


def _check_door(value: onnx.ValueInfoProto, *, free: tuple[int, ...]) -> None:
    tensor = value.type.tensor_type
    kind = onnx.TensorProto.DataType.Name(tensor.elem_type)
    sizes = [size.dim_value if size.HasField("dim_value") else size.dim_param or "?" for size in tensor.shape.dim]
    named = tuple(place for place, size in enumerate(sizes) if isinstance(size, str))
    if kind != "FLOAT" or len(sizes) != 4 or named != free:
        raise RuntimeError(
            f"{value.name!r} should be FLOAT of 4 dimensions with {free} free, but is {kind} {sizes}; it is not written"
        )


def tensors(graph: onnx.GraphProto) -> Iterator[onnx.TensorProto]:
    """Every constant of a graph, those inside its nodes too."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for inner in (*([attribute.g] if attribute.HasField("g") else []), *attribute.graphs):
                yield from tensors(inner)
