"""Eight-bit convolutions for ONNX Runtime: static QDQ, one scale a channel of weights, ranges seen on real guides."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx


def to_int8(model: onnx.ModelProto, guides: Sequence[np.ndarray]) -> onnx.ModelProto:
    """A copy of an exported float32 net whose convolutions compute in 8 bits; all between them stays float32.

    guides: [n, g, h, w], what its activations range over; sizes as the net takes them.
    """
    # heavy, and needed here alone
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.quant_utils import add_pre_process_metadata

    class Reader(CalibrationDataReader):
        def __init__(self) -> None:
            self._guides = iter(guides)

        def get_next(self) -> dict[str, np.ndarray] | None:
            guide = next(self._guides, None)
            return None if guide is None else {"guide": guide}

    model = onnx.ModelProto.FromString(model.SerializeToString())
    add_pre_process_metadata(model)  # the exporter has folded and typed it already; without this it warns
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "int8.onnx"
        quantize_static(
            model,
            path,
            Reader(),
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=["Conv"],
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        quantised = onnx.load(path)
    return quantised
