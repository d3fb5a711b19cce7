"""Guide in, six-way lightmap out, by a run's weights or by an exported ONNX file: the caller cannot tell."""

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import onnxruntime
import torch
from jaxtyping import Float

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.records import GuideMap, SixWayLightmap
from sixway.inference.onnx import read_onnx
from sixway.models.card import NetCard, load_net
from sixway.models.encoding import decode_lightmap
from sixway.models.unet import SixWayUNet


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
    """An exported net under ONNX Runtime; its one image size, one picture at a time."""

    def __init__(self, path: Path, *, device: str) -> None:
        data, self.card = read_onnx(path)
        wanted = "CUDAExecutionProvider" if device.startswith("cuda") else "CPUExecutionProvider"
        if wanted not in onnxruntime.get_available_providers():
            raise ValueError(f"--device {device}: ONNX Runtime has no {wanted}; install onnxruntime-gpu or use cpu")
        try:
            self._session = onnxruntime.InferenceSession(data, providers=[wanted])
        except Exception as error:  # ONNX Runtime's own errors share no base class
            raise ValueError(f"{path}: ONNX Runtime refuses it ({error}); export the run again") from error
        channels, size = self.card.guide_channels, (self.card.height_px, self.card.width_px)
        inputs = [(put.name, put.shape) for put in self._session.get_inputs()]
        outputs = [put.shape for put in self._session.get_outputs()]
        if inputs != [("guide", [1, len(channels), *size])] or outputs != [[1, len(LIGHTMAP_CHANNELS), *size]]:
            raise ValueError(f"{path}: {inputs} -> {outputs} is not what its card says; export the run again")
        self._path = path

    def encoded(self, guide: Float[np.ndarray, "n g h w"]) -> Float[np.ndarray, "n 8 h w"]:
        if guide.shape[2:] != (self.card.height_px, self.card.width_px):
            raise ValueError(
                f"{self._path}: runs at {self.card.width_px} x {self.card.height_px} px only, asked for "
                f"{guide.shape[3]} x {guide.shape[2]}; export another size, or use the run folder"
            )
        answers = [self._session.run(None, {"guide": picture[None]})[0] for picture in guide]
        return np.concatenate(answers)


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
    linear = decode_lightmap(torch.from_numpy(encoded), scale=card.scale)[0].numpy()
    channels = LIGHTMAP_CHANNELS if card.has_emissive else LIGHTMAP_CHANNELS[:-1]
    image = np.maximum(np.moveaxis(linear, 0, -1)[..., : len(channels)], 0.0)
    return SixWayLightmap(channels=channels, image=np.ascontiguousarray(image))
