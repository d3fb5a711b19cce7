"""What a training run is asked for."""

from typing import Literal

from pydantic import Field

from sixway.core.config import Config
from sixway.data.dataset import Draw
from sixway.losses.total import LossConfig
from sixway.models.unet import UNetConfig


class OptimiserConfig(Config):
    """Adam under a warm-up and a cosine, on pairs of consecutive frames."""

    steps: int = Field(ge=1)
    pairs_per_batch: int = Field(default=2, ge=1)
    """Of the smallest image size; a larger size takes fewer. A batch holds twice as many pictures."""
    draw: Draw = "pictures"
    """How a batch's image size is drawn: `pictures` shows every picture equally often, `sizes` gives every
    size the same share of the batches."""
    lr: float = Field(default=1e-3, gt=0.0)
    warmup_steps: int = Field(default=50, ge=1)
    clip_norm: float = Field(default=1.0, gt=0.0)
    ema: float = Field(default=0.999, ge=0.0, lt=1.0)
    """Decay of the averaged weights, which are what is saved, evaluated and exported."""
    flip: bool = True
    precision: Literal["fp32", "bf16"] = "fp32"
    """Of the net's forward and backward pass; weights, averages and loss stay fp32."""
    seed: int = Field(default=0, ge=0)
    log_every: int = Field(default=50, ge=1)
    validate_every: int = Field(default=500, ge=1)
    checkpoint_every: int = Field(default=500, ge=1)
    tensorboard: bool = False
    """Also log for TensorBoard, to `tensorboard/` in the run's folder."""


class TrainConfig(Config):
    """A training run: which data, which guide, which net, which loss."""

    data: str
    """Dataset folder."""
    guide: str
    """Guide variant of the dataset that the net reads."""
    net: UNetConfig = UNetConfig()
    train: OptimiserConfig
    loss: LossConfig = LossConfig()
