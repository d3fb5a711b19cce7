"""The sRGB curve (IEC 61966-2-1), written so that one text serves NumPy arrays and torch tensors.

The piecewise curve is a sum of two clipped halves, so it needs no ``where``: gradients stay finite
at zero and the ONNX graph holds plain operators only. Values above 1 are allowed (the curve goes
on); values below 0 read as 0.
"""

from typing import TypeVar

Array = TypeVar("Array")

_LINEAR_KNEE = 0.0031308
_ENCODED_KNEE = 12.92 * _LINEAR_KNEE
_ENCODE_JOIN = 1.055 * _LINEAR_KNEE ** (1.0 / 2.4) - 0.055
_DECODE_JOIN = ((_ENCODED_KNEE + 0.055) / 1.055) ** 2.4


def encode_srgb(linear: Array) -> Array:
    """Linear radiance (>= 0) to its sRGB code, any shape; 0 -> 0 and 1 -> 1."""
    toe = 12.92 * linear.clip(0.0, _LINEAR_KNEE)  # type: ignore[attr-defined]
    curve = 1.055 * linear.clip(_LINEAR_KNEE, None) ** (1.0 / 2.4) - 0.055  # type: ignore[attr-defined]
    return toe + (curve - _ENCODE_JOIN)


def decode_srgb(encoded: Array) -> Array:
    """The inverse of :func:`encode_srgb`, any shape."""
    toe = encoded.clip(0.0, _ENCODED_KNEE) / 12.92  # type: ignore[attr-defined]
    curve = ((encoded.clip(_ENCODED_KNEE, None) + 0.055) / 1.055) ** 2.4  # type: ignore[attr-defined]
    return toe + (curve - _DECODE_JOIN)
