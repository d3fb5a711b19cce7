"""What a dataset says of itself: `manifest.json`, checked when it is read.

A dataset folder keeps its layers apart: ``density/``, ``target/``, ``guide_<name>/`` and ``flow/`` hold
one file a frame below ``<simulation>/[<view>/]<hash of the config that made it>/``; ``packed/`` holds the
arrays that training reads. A new guide re-marches and never re-traces.
"""

from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sixway.core.config import STORED, Config, Identity
from sixway.core.store import read_json

FORMAT = 1
MANIFEST = "manifest.json"
Split = Literal["train", "val", "test"]

CONVENTIONS = {
    "lightmap": "M = pi * L / E: linear radiance towards the camera on black (alpha-premultiplied) per irradiance E",
    "alpha": "1 - transmittance along the camera ray, linear",
    "directions": "the name says where the light comes from; camera frame x right, y up, z towards the viewer",
    "scale": "maps times scale have their 99.9th percentile at 1 over the training split",
    "emissive_scale": "the same of emissive, over the training pixels that burn; null where none does",
    "flow": "px per frame, right and down, from this frame to the next; opacity-weighted mean along the ray",
    "order": "rows 2i and 2i+1 of a packed array are consecutive frames of one view",
}


class PackedArray(Config):
    """One float16 .npy file [n, c, h, w] below the dataset folder."""

    path: str
    sha256: str
    channels: tuple[str, ...]


class Sample(Config):
    """One row of a group's packed arrays, its view, and the frame on disk behind it."""

    simulation: str
    view: str
    frame: int
    yaw_deg: float
    pitch_deg: float
    margin: float
    density_scale: float
    seed: int
    target: str
    target_sha256: str


class Group(Config):
    """All samples of one split and one image size."""

    split: Split
    height_px: int = Field(ge=1)
    width_px: int = Field(ge=1)
    arrays: dict[str, PackedArray]
    samples: tuple[Sample, ...]


class NoiseSummary(Config):
    """Standard error of the references' maps, linear, times the scale: 1 is white. Each frame's own is in its header.

    The smaller, the less of the truth a net can miss unseen; frames are told by the path of their file.
    """

    median_rmse: float
    worst_rmse: float
    worst_frame: str


class GuideLights(BaseModel):
    """What flips must know of a guide; all else that its room wrote is for that room.

    sum_lights: one channel for all `lights` together.
    """

    model_config = ConfigDict(extra="ignore", frozen=True)

    lights: tuple[str, ...]
    sum_lights: bool


class Manifest(Config):
    """The whole dataset. guides: each variant, as its room names it. noise_psnr_db: PSNR of
    two test references with other seeds, sRGB; a perfect net scores 3.01 dB more. The scales are what `conventions`
    says of them."""

    format: Literal[1] = 1
    name: str
    scale: float = Field(gt=0.0)
    emissive_scale: float | None = Field(default=None, gt=0.0)
    medium: dict[str, float]
    guides: dict[str, Identity]
    groups: tuple[Group, ...]
    noise_psnr_db: float | None = None
    noise: NoiseSummary | None = None
    config: dict[str, Any]
    provenance: dict[str, str]
    conventions: dict[str, str] = CONVENTIONS

    def split(self, name: Split) -> tuple[Group, ...]:
        """The groups of one split; raises ValueError if it is empty."""
        groups = tuple(group for group in self.groups if group.split == name)
        if not groups:
            raise ValueError(f"dataset {self.name!r} has no {name} samples; give a simulation that split")
        return groups


def read_manifest(folder: Path) -> Manifest:
    """Read and check a dataset's manifest.

    Raises FileNotFoundError if the dataset is not finished, ValueError if the file does not fit.
    """
    path = folder / MANIFEST
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no finished dataset here; run: python data_gen/generate.py configs/data/tiny.yaml --out {folder}"
        )
    read_json(path)
    try:
        return Manifest.model_validate_json(path.read_bytes(), context=STORED)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise ValueError(f"{path}: {place}: {first['msg']}; generate the dataset with this version again") from error
