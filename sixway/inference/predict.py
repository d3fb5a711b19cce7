"""Guide in, six-way lightmap out, by a run's weights or by an exported ONNX file: the caller cannot tell."""

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import onnxruntime
import torch
from jaxtyping import Float

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.records import GuideMap, SixWayLightmap
from sixway.inference.onnx_file import read_onnx
from sixway.inference.padding import pad_guide
from sixway.models.card import NetCard, load_net
from sixway.models.encoding import decode_lightmap
from sixway.models.unet import SixWayUNet

SHIPPED_NET = Path(__file__).parents[1] / "zoo" / "unet_naf"
"""Folder of the net that comes with sixway, for smoke that nobody trained on; its README.md has the scores."""


@runtime_checkable
class Predictor(Protocol):
    """Something that answers a guide in the net's own encoding, and the card that says what that means."""

    card: NetCard

    def encoded(self, guide: Float[np.ndarray, "n g h w"]) -> Float[np.ndarray, "n 8 h w"]:
        """sRGB-encoded scaled light and linear alpha, in the order of `LIGHTMAP_CHANNELS`."""
        ...


class TorchPredictor:
    """A trained net on a torch device; any image size."""

    def __init__(self, net: SixWayUNet, card: NetCard, *, device: str) -> None:
        self.card = card
        try:
            self._net = net.to(device).eval()
        except (RuntimeError, AssertionError) as error:  # torch without CUDA asserts
            reason = str(error).splitlines()[0]
            raise ValueError(f"--device {device}: torch cannot use it ({reason}); use cpu, or cuda on a GPU") from error
        self._device = device

    @torch.inference_mode()
    def encoded(self, guide: Float[np.ndarray, "n g h w"]) -> Float[np.ndarray, "n 8 h w"]:
        answer: np.ndarray = self._net(torch.from_numpy(guide).to(self._device)).cpu().numpy()
        return answer


class OnnxPredictor:
    """An exported net under ONNX Runtime: a file for engines at its one size and picture by picture, one for `ort`
    at any size and as whole batches."""

    def __init__(self, path: Path, *, device: str) -> None:
        data, self.card = read_onnx(path)
        wanted = "CUDAExecutionProvider" if device.startswith("cuda") else "CPUExecutionProvider"
        if wanted not in onnxruntime.get_available_providers():
            raise ValueError(f"--device {device}: ONNX Runtime has no {wanted}; install onnxruntime-gpu or use cpu")
        try:
            self._session = onnxruntime.InferenceSession(data, providers=[wanted])
        except Exception as error:  # ONNX Runtime's own errors share no base class
            raise ValueError(f"{path}: ONNX Runtime refuses it ({error}); export the run again") from error
        inputs = [(put.name, put.type, _free_as_none(put.shape)) for put in self._session.get_inputs()]
        outputs = [(put.type, _free_as_none(put.shape)) for put in self._session.get_outputs()]
        guides, maps, size = (
            len(self.card.guide_channels),
            len(LIGHTMAP_CHANNELS),
            (self.card.height_px, self.card.width_px),
        )
        found = (inputs, outputs)
        self._any_size = found == _doors(None, guides, maps, None, None)
        if not self._any_size and found != _doors(1, guides, maps, *size):
            raise ValueError(f"{path}: {inputs} -> {outputs} is not what its card says; export the run again")
        self._path = path

    def encoded(self, guide: Float[np.ndarray, "n g h w"]) -> Float[np.ndarray, "n 8 h w"]:
        height, width = guide.shape[2:]
        if self._any_size:
            # the net pads by itself, its graph for any size does not
            padded = pad_guide(guide, self.card.guide_channels, 2 ** len(self.card.net.widths))
            answer: np.ndarray = self._session.run(None, {"guide": padded})[0]
            return answer[:, :, :height, :width]
        if (height, width) != (self.card.height_px, self.card.width_px):
            raise ValueError(
                f"{self._path}: runs at {self.card.width_px} x {self.card.height_px} px only, asked for "
                f"{width} x {height}; export that size or --target ort, or use the run folder"
            )
        answers = [self._session.run(None, {"guide": picture[None]})[0] for picture in guide]
        return np.concatenate(answers)


def _free_as_none(shape: list[int | str | None]) -> list[int | None]:
    return [size if isinstance(size, int) else None for size in shape]


def _doors(batch: int | None, guides: int, maps: int, height: int | None, width: int | None) -> tuple[list, list]:
    """What a session of a file of ours takes and gives."""
    kind = "tensor(float)"
    return [("guide", kind, [batch, guides, height, width])], [(kind, [batch, maps, height, width])]


def load_predictor(path: Path, *, device: str) -> Predictor:
    """A run folder or an .onnx file, ready to answer.

    Raises FileNotFoundError, or ValueError if it is not a net of ours.
    """
    if path.suffix == ".onnx":
        return OnnxPredictor(path, device=device)
    net, card = load_net(path)
    return TorchPredictor(net, card, device=device)


def predict(predictor: Predictor, guide: GuideMap) -> SixWayLightmap:
    """One guide to one physical lightmap. Raises ValueError if the net reads another guide."""
    card = predictor.card
    if guide.channels != card.guide_channels:
        raise ValueError(f"this net reads the guide {card.guide_channels}, got {guide.channels}")
    encoded = predictor.encoded(np.ascontiguousarray(np.moveaxis(guide.image, -1, 0))[None])
    decoded = decode_lightmap(torch.from_numpy(encoded), scale=card.scale, emissive_scale=card.emissive_scale)
    linear = decoded[0].numpy()
    channels = LIGHTMAP_CHANNELS if card.has_emissive else LIGHTMAP_CHANNELS[:-1]
    image = np.maximum(np.moveaxis(linear, 0, -1)[..., : len(channels)], 0.0)
    return SixWayLightmap(channels=channels, image=np.ascontiguousarray(image))
