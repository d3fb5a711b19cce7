"""The ONNX file for engines: opset 15, static shape, float32, plain operators, one self-contained file.

Unity's Inference Engine and Unreal's NNE read opsets 7 to 15 and a short list of operators; a browser
cannot fetch weights from a second file. What is written here is checked against all of that.
"""

import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from jaxtyping import Float
from torch import Tensor, nn

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.store import atomic_path
from sixway.models.card import NetCard, read_card
from sixway.models.unet import SixWayUNet

OPSET = 15
METADATA_KEY = "sixway"
PARITY = 1e-4
"""Largest difference between torch and ONNX Runtime that an export may show."""

PLAIN_OPERATORS = frozenset(
    "Add AveragePool Clip Concat Constant Conv DepthToSpace Div GlobalAveragePool Identity LeakyRelu Mul Pow "
    "ReduceMean Relu Sigmoid Slice Sqrt Sub".split()
)
"""Operators that Unity, Unreal, onnxruntime-web and TensorRT all run."""

_LARGEST_FILE_BYTES = 1 << 30

METADATA = {
    "input": "guide: raw channels as named in the card; light in units M = pi L / E",
    "output": "lightmap: sRGB-encoded M * scale for the six maps and emissive, linear alpha = 1 - T; all >= 0",
    "output_channels": ",".join(LIGHTMAP_CHANNELS),
    "directions": "where light comes FROM; camera frame x right, y up, z towards the viewer",
    "rows": "row 0 is the top of the image",
}


class _Clamped(nn.Module):
    """The net as an engine wants it: light not negative, alpha in [0, 1]."""

    def __init__(self, net: SixWayUNet) -> None:
        super().__init__()
        self.net = net

    def forward(self, guide: Float[Tensor, "n g h w"]) -> Float[Tensor, "n 8 h w"]:
        answer = self.net(guide)
        alpha = LIGHTMAP_CHANNELS.index("alpha")
        light, rest = answer[:, :alpha].clamp(min=0.0), answer[:, alpha + 1 :].clamp(min=0.0)
        return torch.cat([light, answer[:, alpha : alpha + 1].clamp(0.0, 1.0), rest], dim=1)


def export_onnx(net: SixWayUNet, card: NetCard, path: Path, *, width_px: int, height_px: int) -> float:
    """Write the file and return its largest difference from torch on a random guide.

    Raises RuntimeError, and writes nothing, if the file would need another opset, an operator outside
    `PLAIN_OPERATORS`, or differ by more than `PARITY`.
    """
    clamped = _Clamped(net.cpu().eval()).eval()
    guide = torch.rand(1, len(card.guide_channels), height_px, width_px, generator=torch.Generator().manual_seed(0))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        file = Path(folder) / "net.onnx"
        # tracing turns sizes into constants, on purpose; the exporter for opset 15 is the older one
        warnings.simplefilter("ignore")
        torch.onnx.export(
            clamped,
            (guide,),
            file,
            dynamo=False,
            opset_version=OPSET,
            input_names=["guide"],
            output_names=["lightmap"],
        )
        model = onnx.load(file)
    exported_card = card.model_copy(update={"width_px": width_px, "height_px": height_px})
    for key, value in {METADATA_KEY: exported_card.model_dump_json(), **METADATA}.items():
        model.metadata_props.add(key=key, value=value)
    _check_plain(model)
    data = model.SerializeToString()
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    with torch.inference_mode():
        expected = clamped(guide).numpy()
    difference = float(np.abs(session.run(None, {"guide": guide.numpy()})[0] - expected).max())
    if not difference <= PARITY:
        raise RuntimeError(
            f"the ONNX file differs from torch by {difference:.2e}, over {PARITY:.0e}; it is not written"
        )
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
    return difference


def _check_plain(model: onnx.ModelProto) -> None:
    onnx.checker.check_model(model, full_check=True)
    opsets = {entry.domain: entry.version for entry in model.opset_import}
    if opsets != {"": OPSET}:
        raise RuntimeError(f"the exporter wrote opsets {opsets}, wanted {OPSET} alone; it is not written")
    strange = {node.op_type for node in model.graph.node} - PLAIN_OPERATORS
    if strange:
        raise RuntimeError(f"the net exports to operators {sorted(strange)} that engines may lack; it is not written")


def read_onnx(path: Path) -> tuple[bytes, NetCard]:
    """The bytes of an exported file and the card in its metadata.

    Raises FileNotFoundError, or ValueError if the file is no ONNX file, not ours, or names outside data.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such ONNX file; make one with: python -m sixway.export RUN_DIR")
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise ValueError(f"{path}: larger than {_LARGEST_FILE_BYTES} bytes; this is no net of ours")
    data = path.read_bytes()
    ours = "make one with: python -m sixway.export RUN_DIR"
    try:
        model = onnx.load_from_string(data)
    except Exception as error:  # protobuf raises DecodeError of several classes
        raise ValueError(f"{path}: not a readable ONNX file ({error}); {ours}") from error
    if any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in _tensors(model.graph)):
        raise ValueError(f"{path}: keeps weights in another file, which is refused; {ours}")
    entries = {entry.key: entry.value for entry in model.metadata_props}
    if METADATA_KEY not in entries:
        raise ValueError(f"{path}: an ONNX file without sixway metadata, so its channels are unknown; {ours}")
    return data, read_card(entries[METADATA_KEY], source=str(path))


def _tensors(graph: onnx.GraphProto) -> Iterator[onnx.TensorProto]:
    """Every constant of a graph, those inside its nodes too."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            yield from (attribute.t, *attribute.tensors)
            for inner in (*([attribute.g] if attribute.HasField("g") else []), *attribute.graphs):
                yield from _tensors(inner)
