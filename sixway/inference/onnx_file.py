"""An exported file on disk: one ONNX graph with the net's card and the conventions in its metadata."""

from pathlib import Path

import onnx

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.inference.onnx_rules import tensors
from sixway.models.card import NetCard, read_card

METADATA_KEY = "sixway"
METADATA = {
    "input": "guide: raw channels as named in the card; light in units M = pi L / E",
    "output": "lightmap: sRGB-encoded M * scale for the six maps, linear alpha = 1 - T, sRGB-encoded emissive "
    "* emissive_scale (null: scale); all >= 0",
    "output_channels": ",".join(LIGHTMAP_CHANNELS),
    "directions": "where light comes FROM; camera frame x right, y up, z towards the viewer",
    "rows": "row 0 is the top of the image",
}

_LARGEST_FILE_BYTES = 1 << 30
_REMEDY = "make one with: python -m sixway.export RUN_DIR"


def add_metadata(model: onnx.ModelProto, card: NetCard, **more: str) -> None:
    """Make the card, the conventions and `more` the file's metadata."""
    del model.metadata_props[:]
    for key, value in {METADATA_KEY: card.model_dump_json(), **METADATA, **more}.items():
        model.metadata_props.add(key=key, value=value)


def read_onnx(path: Path) -> tuple[bytes, NetCard]:
    """The bytes of an exported file and the card in its metadata.

    Raises FileNotFoundError, or ValueError if the file is no ONNX file, not ours, or names outside data.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such ONNX file; {_REMEDY}")
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise ValueError(f"{path}: larger than {_LARGEST_FILE_BYTES} bytes; this is no net of ours")
    data = path.read_bytes()
    try:
        model = onnx.load_from_string(data)
    except Exception as error:  # protobuf raises DecodeError of several classes
        raise ValueError(f"{path}: not a readable ONNX file ({error}); {_REMEDY}") from error
    if any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in tensors(model.graph)):
        raise ValueError(f"{path}: keeps weights in another file, which is refused; {_REMEDY}")
    entries = {entry.key: entry.value for entry in model.metadata_props}
    if METADATA_KEY not in entries:
        raise ValueError(f"{path}: an ONNX file without sixway metadata, so its channels are unknown; {_REMEDY}")
    return data, read_card(entries[METADATA_KEY], source=str(path))
