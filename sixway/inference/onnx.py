"""A trained net as one self-contained ONNX file: traced, converted, held to the rules of its readers, compared.

`export_onnx` writes for engines, at one size; `export_onnx_dynamic` for ONNX Runtime, at any. Nothing is written that
breaks `onnx_rules` or differs from torch by more than its precision should.
"""

import io
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import atomic_path
from sixway.inference.onnx_file import add_metadata
from sixway.inference.onnx_half import to_half
from sixway.inference.onnx_int8 import to_int8
from sixway.inference.onnx_rules import LACKING_POOL_OPTIONS, OPSETS, Precision, Target, check_rules
from sixway.models.card import NetCard
from sixway.models.unet import SixWayUNet

Guides = Sequence[np.ndarray]
"""Of shape [n, g, h, w], float32; sizes may differ."""


@dataclass(frozen=True)
class Difference:
    """Of a file's answers from torch's, in the net's encoding (0 to about 1)."""

    largest: float
    rms: float

    def __str__(self) -> str:
        return f"at most {self.largest:.1e}, {self.rms:.1e} rms"


PARITY: dict[Precision, Difference] = {
    "fp32": Difference(largest=1e-4, rms=1e-5),
    "fp16": Difference(largest=1e-2, rms=1e-3),
    # single pixels may be far off in 8 bits; 0.02 rms is 34 dB
    "int8": Difference(largest=np.inf, rms=2e-2),
}
"""The most that an export may differ."""


class EngineNet(nn.Module):
    """The net as an engine wants it: light not negative, alpha in [0, 1]."""

    def __init__(self, net: SixWayUNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, guide: Float[Tensor, "n g h w"]) -> Float[Tensor, "n 8 h w"]:
        answer = self.net(guide)
        alpha = LIGHTMAP_CHANNELS.index("alpha")
        light, rest = answer[:, :alpha].clamp(min=0.0), answer[:, alpha + 1 :].clamp(min=0.0)
        return torch.cat([light, answer[:, alpha : alpha + 1].clamp(0.0, 1.0), rest], dim=1)


def export_onnx(
    net: SixWayUNet, card: NetCard, path: Path, *, width_px: int, height_px: int, precision: Precision = "fp32"
) -> Difference:
    """Write the file for engines, static in shape, and return its difference from torch on a random guide.

    Raises ValueError for int8, which no engine reads; RuntimeError, and writes nothing, if the file would break
    `onnx_rules` or differ by more than `PARITY`.
    """
    if precision == "int8":
        raise ValueError("int8: engines lack QuantizeLinear and DequantizeLinear; take fp16, or the target ort")
    wanted = EngineNet(net.cpu().eval()).eval()
    guide = _random_guide(card, 1, height_px, width_px)
    model = _trace_static(wanted, guide)
    if precision == "fp16":
        model = to_half(model)
    card = card.model_copy(update={"width_px": width_px, "height_px": height_px})
    return _finish(model, wanted, [guide], card, path, target="engine", precision=precision)


def export_onnx_dynamic(
    net: SixWayUNet, card: NetCard, path: Path, *, precision: Precision = "fp32", guides: Guides = ()
) -> Difference:
    """Write the file for ONNX Runtime, whose height and width are any multiples of the net's stride.

    guides: for int8 alone, pictures of the training, at least two, of sizes that the file takes: every other one
    calibrates, the rest tell the difference. Raises as `export_onnx` does; ValueError for too few guides.
    """
    model = trace_dynamic(net, card)
    return finish_dynamic(model, net, card, path, precision=precision, guides=guides)


def finish_dynamic(
    model: onnx.ModelProto,
    net: SixWayUNet,
    card: NetCard,
    path: Path,
    *,
    precision: Precision = "fp32",
    guides: Guides = (),
) -> Difference:
    """`export_onnx_dynamic` from what `trace_dynamic` gave: tracing is slow, and every precision can share it."""
    stride = net.stride
    judges: Guides = [_random_guide(card, 2, 2 * stride, 3 * stride), _random_guide(card, 1, 4 * stride, stride)]
    if precision == "fp16":
        model = to_half(model)
    if precision == "int8":
        if len(guides) < 2:
            raise ValueError(f"int8 takes at least 2 guides to calibrate and to judge with, got {len(guides)}")
        model, judges = to_int8(model, guides[::2]), guides[1::2]
    return _finish(model, EngineNet(net.cpu().eval()).eval(), judges, card, path, target="ort", precision=precision)


def _trace_static(net: EngineNet, guide: np.ndarray) -> onnx.ModelProto:
    """By the legacy exporter, which alone writes opset 15; it turns sizes into constants, on purpose."""
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            net,
            (torch.from_numpy(guide),),
            file,  # type: ignore[arg-type]  # torch takes a stream, its stubs do not
            dynamo=False,
            opset_version=OPSETS["engine"],
            input_names=["guide"],
            output_names=["lightmap"],
        )
    model = onnx.load_from_string(file.getvalue())
    for node in model.graph.node:
        if node.op_type == "AveragePool":
            _drop_idle_options(node)
    return model


def _drop_idle_options(pool: onnx.NodeProto) -> None:
    """How a pool treats borders: engines lack the options, and a pool without borders does not need them."""
    options = {attribute.name: onnx.helper.get_attribute_value(attribute) for attribute in pool.attribute}
    if not any(options.get("pads", [])) and not options.get("ceil_mode", 0):
        kept = [attribute for attribute in pool.attribute if attribute.name not in LACKING_POOL_OPTIONS]
        del pool.attribute[:]
        pool.attribute.extend(kept)


def trace_dynamic(net: SixWayUNet, card: NetCard) -> onnx.ModelProto:
    """The float32 graph of opset 18 whose batch is free, and height and width in multiples of the stride.

    It is traced at one size and holds nothing of it, which `finish_dynamic` proves at others: symbolic sizes
    give the same graph and take several times as long.
    """
    stride = net.stride
    guide = torch.from_numpy(_random_guide(card, 2, 3 * stride, 4 * stride))
    with warnings.catch_warnings(), _quiet("torch.onnx._internal.exporter._registration"):
        warnings.simplefilter("ignore")
        # not strict: the graph as Python runs it; and no second attempt by slower ways, as torch.onnx would make
        program = torch.export.export(EngineNet(net.cpu().eval()).eval(), (guide,), strict=False)
        exported = torch.onnx.export(
            program,
            (),
            dynamo=True,
            opset_version=OPSETS["ort"],
            input_names=["guide"],
            output_names=["lightmap"],
            external_data=False,
            verbose=False,
        )
    assert exported is not None
    model: onnx.ModelProto = exported.model_proto
    _tidy(model, stride)
    return model


def _tidy(model: onnx.ModelProto, stride: int) -> None:
    """Free the sizes, and drop the exporter's notes: Python's lines and paths, larger than the graph."""
    graph = model.graph
    del graph.value_info[:]
    for noted in (model, graph, *graph.node, *graph.input, *graph.output, *graph.initializer):
        del noted.metadata_props[:]
        noted.doc_string = ""
    for value in (*graph.input, *graph.output):
        batch, _, height, width = value.type.tensor_type.shape.dim
        batch.dim_param, height.dim_param, width.dim_param = "batch", f"{stride}*rows", f"{stride}*columns"


@contextmanager
def _quiet(logger: str) -> Iterator[None]:
    """torch tells every time that torchvision is absent, which nothing here needs."""
    told = logging.getLogger(logger)
    before = told.level
    told.setLevel(logging.ERROR)
    try:
        yield
    finally:
        told.setLevel(before)


def _finish(
    model: onnx.ModelProto,
    net: EngineNet,
    guides: Guides,
    card: NetCard,
    path: Path,
    *,
    target: Target,
    precision: Precision,
) -> Difference:
    """Check, compare, write."""
    stride = net.net.stride
    sizes = (
        f"{card.width_px} x {card.height_px} px" if target == "engine" else f"height and width multiples of {stride} px"
    )
    add_metadata(model, card, target=target, precision=precision, sizes=sizes)
    del model.graph.value_info[:]  # readers infer it
    check_rules(model, target=target, precision=precision)
    data = model.SerializeToString()
    difference, most = _difference(data, net, guides), PARITY[precision]
    if not (difference.largest <= most.largest and difference.rms <= most.rms):  # NaN is over
        raise RuntimeError(
            f"the ONNX file differs from torch by {difference}, over {most} for {precision}; it is not written"
        )
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
    return difference


def _difference(data: bytes, net: EngineNet, guides: Guides) -> Difference:
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    apart = []
    for guide in guides:
        with torch.inference_mode():
            expected = net(torch.from_numpy(guide)).numpy()
        apart.append(np.abs(session.run(None, {"guide": guide})[0] - expected).ravel())
    everywhere = np.concatenate(apart)
    return Difference(float(everywhere.max()), float(np.sqrt(np.mean(everywhere**2, dtype=np.float64))))


def _random_guide(card: NetCard, batch: int, height_px: int, width_px: int) -> np.ndarray:
    shape = (batch, len(card.guide_channels), height_px, width_px)
    return np.random.default_rng(0).random(shape, dtype=np.float32)
