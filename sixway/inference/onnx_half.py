"""Half precision where the arithmetic is, float32 where a half would lose the answer.

Weights and features between the first and the last convolutions become float16. float32 stay: what comes before the
first (1 - T would lose faint smoke; the share of smoke of a lone pixel is the number of pixels, at 512^2 more than any
half), what comes after the last (the guide's own maps pass through to the answer), means, and what divides by them.
The converter of ONNX Runtime is not used: it rounds to half between any two nodes that it leaves in float32.
"""

from collections.abc import Iterable

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

_NEEDS_RANGE = frozenset({"ReduceMean", "Sub", "Div", "Sqrt", "Pow"})
_FEEDS_RANGE = frozenset({"Add", "Mul"})


def to_half(model: onnx.ModelProto) -> onnx.ModelProto:
    """A copy of an exported float32 net with float16 inside; its input and output stay float32."""
    model = onnx.ModelProto.FromString(model.SerializeToString())
    graph = model.graph
    _name_constants(graph)
    half = _half_nodes(graph)
    constants = {tensor.name: tensor for tensor in graph.initializer if tensor.data_type == TensorProto.FLOAT}
    element = {value.name: value.type.tensor_type.elem_type for value in _typed(model)}
    made: dict[str, bool] = {graph.input[0].name: False}  # value -> is half
    cast: dict[str, str] = {}
    nodes, halves = [], {}
    for node, is_half in zip(graph.node, half, strict=True):
        for place, name in enumerate(node.input):
            if name in constants and is_half:
                node.input[place] = f"{name}_half"
                halves[name] = node.input[place]
            elif name in made and made[name] != is_half and element.get(name) == TensorProto.FLOAT:
                if name not in cast:
                    cast[name] = f"{name}_{'half' if is_half else 'float'}"
                    to = TensorProto.FLOAT16 if is_half else TensorProto.FLOAT
                    nodes.append(helper.make_node("Cast", [name], [cast[name]], name=f"Cast_{cast[name]}", to=to))
                node.input[place] = cast[name]
        made |= dict.fromkeys(node.output, is_half)
        nodes.append(node)
    _replace(graph.node, nodes)
    used = {name for node in nodes for name in node.input}
    whole = [tensor for tensor in graph.initializer if tensor.name in used]
    _replace(graph.initializer, whole + [_halved(constants[name], new) for name, new in halves.items()])
    del graph.value_info[:]
    return model


def _half_nodes(graph: onnx.GraphProto) -> list[bool]:
    """Whether each node, in the order of the graph, computes in half."""
    nodes = graph.node
    from_convolution: set[str] = set()
    after = []
    for node in nodes:
        after.append(node.op_type == "Conv" or not from_convolution.isdisjoint(node.input))
        if after[-1]:
            from_convolution.update(node.output)
    readers: dict[str, list[int]] = {}
    for place, node in enumerate(nodes):
        for name in node.input:
            readers.setdefault(name, []).append(place)
    before, half = [False] * len(nodes), [False] * len(nodes)
    for place in reversed(range(len(nodes))):
        node = nodes[place]
        read_by = [reader for name in node.output for reader in readers.get(name, [])]
        before[place] = node.op_type == "Conv" or any(before[reader] for reader in read_by)
        # arithmetic that only float32 reads gains nothing from a half, and may not fit it
        only_for_float = node.op_type in _FEEDS_RANGE and not any(half[reader] for reader in read_by)
        half[place] = after[place] and before[place] and node.op_type not in _NEEDS_RANGE and not only_for_float
    return half


def _name_constants(graph: onnx.GraphProto) -> None:
    """Constant nodes become initializers."""
    constant = [node for node in graph.node if node.op_type == "Constant"]
    for node in constant:
        tensor = helper.get_node_attr_value(node, "value")
        graph.initializer.add().CopyFrom(tensor)
        graph.initializer[-1].name = node.output[0]
    _replace(graph.node, [node for node in graph.node if node.op_type != "Constant"])


def _typed(model: onnx.ModelProto) -> Iterable[onnx.ValueInfoProto]:
    graph = onnx.shape_inference.infer_shapes(model).graph
    return (*graph.input, *graph.value_info, *graph.output)


def _halved(tensor: onnx.TensorProto, name: str) -> onnx.TensorProto:
    return numpy_helper.from_array(numpy_helper.to_array(tensor).astype(np.float16), name)


def _replace(field: object, values: list) -> None:
    """In place of all that a repeated field holds; copies first, since protobuf clears what it deletes."""
    kept = [type(value).FromString(value.SerializeToString()) for value in values]
    del field[:]  # type: ignore[attr-defined]
    field.extend(kept)  # type: ignore[attr-defined]
