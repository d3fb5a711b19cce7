"""From where, how large and through how much smoke every simulation of a dataset is seen."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from sixway.core.config import Config, ConfigError
from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame
from sixway.core.store import content_hash

Margin = Annotated[float, Field(ge=0.5, le=4.0)]
Pixels = Annotated[int, Field(ge=8, le=4096)]
DensityScale = Annotated[float, Field(gt=0.0, le=100.0)]
Pitch = Annotated[float, Field(gt=-90.0, lt=90.0)]

_FINEST = {"angle_deg": 0.1, "margin": 0.01, "density_scale": 0.01}
"""Steps of what is drawn, so that the name of a view says all of it."""


class _Lens(Config):
    kind: Literal["orthographic", "perspective"] = "perspective"
    fov_deg: float = Field(default=30.0, ge=1.0, le=120.0)


class FixedViews(_Lens):
    """Each yaw with each pitch and each density scale.

    margin: radius of what the image frames, in radii of the volume's bounding sphere. density_scales: the
    smoke is made that many times as dense before it is seen.
    """

    yaws_deg: tuple[float, ...] = Field(default=(0.0,), min_length=1)
    pitches_deg: tuple[Pitch, ...] = Field(default=(0.0,), min_length=1)
    density_scales: tuple[DensityScale, ...] = Field(default=(1.0,), min_length=1)
    margin: Margin = 1.0
    width_px: Pixels = 64
    height_px: Pixels = 64


class DrawnViews(_Lens):
    """Cameras drawn at random, others for every simulation: angles and margin evenly, density scale by its logarithm.

    drawn: how many; raising it keeps the earlier ones. sizes_px: edges of the square pictures, drawn evenly, so
    one named twice comes twice as often.
    """

    drawn: int = Field(ge=1, le=10_000)
    yaw_deg: tuple[float, float] = (0.0, 90.0)
    pitch_deg: tuple[Pitch, Pitch] = (0.0, 0.0)
    margin: tuple[Margin, Margin] = (1.0, 1.0)
    density_scale: tuple[DensityScale, DensityScale] = (1.0, 1.0)
    sizes_px: tuple[Pixels, ...] = Field(default=(128,), min_length=1)

    @model_validator(mode="after")
    def _ranges_rise(self) -> Self:
        for name in ("yaw_deg", "pitch_deg", "margin", "density_scale"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"{name} [{low}, {high}] runs backwards; give the smaller number first")
        return self


def _is_drawn(views: Any) -> str:
    return "drawn" if isinstance(views, DrawnViews) or (isinstance(views, dict) and "drawn" in views) else "fixed"


Views = Annotated[Annotated[FixedViews, Tag("fixed")] | Annotated[DrawnViews, Tag("drawn")], Discriminator(_is_drawn)]
"""A set of cameras; whoever names ``drawn`` has them drawn."""


@dataclass(frozen=True, kw_only=True)
class DatasetView:
    """A camera around a grid, by the settings that its name tells. density_scale: factor on the smoke that it sees."""

    kind: Literal["orthographic", "perspective"]
    fov_deg: float
    yaw_deg: float
    pitch_deg: float
    margin: float
    density_scale: float
    width_px: int
    height_px: int
    camera: Camera

    @property
    def name(self) -> str:
        """The name of its folder; unique among the views of a simulation."""
        return (
            f"yaw{self.yaw_deg:+g}_pitch{self.pitch_deg:+g}_{self.width_px}x{self.height_px}"
            f"_margin{self.margin:g}_density{self.density_scale:g}"
        )

    @property
    def made_by(self) -> dict[str, Any]:
        """All that a picture of it depends on, as plain values."""
        return {key: value for key, value in vars(self).items() if key != "camera"}

    def seen(self, frame: DensityFrame) -> DensityFrame:
        """The smoke as this view has it."""
        return frame if self.density_scale == 1.0 else replace(frame, density=frame.density * self.density_scale)


def views_around(
    grid: Grid, sets: Sequence[FixedViews | DrawnViews], *, seed: Sequence[int | str]
) -> tuple[DatasetView, ...]:
    """The views of one simulation. seed: what the drawn ones depend on. Raises ConfigError if two are the same."""
    views = []
    for place, views_of_set in enumerate(sets):
        if isinstance(views_of_set, FixedViews):
            views += list(_fixed(grid, views_of_set))
        else:
            views += list(_drawn(grid, views_of_set, [*seed, place]))
    twice = sorted(name for name, count in Counter(view.name for view in views).items() if count > 1)
    if twice:
        raise ConfigError(f"views: {', '.join(twice)} would be made twice; list each camera once")
    return tuple(views)


def _fixed(grid: Grid, views: FixedViews) -> Iterator[DatasetView]:
    for yaw in views.yaws_deg:
        for pitch in views.pitches_deg:
            for scale in views.density_scales:
                yield _view(grid, views, yaw, pitch, views.margin, scale, views.width_px, views.height_px)


def _drawn(grid: Grid, views: DrawnViews, seed: Sequence[int | str]) -> Iterator[DatasetView]:
    for number in range(views.drawn):
        rng = np.random.default_rng(int(content_hash([*seed, number]), 16))
        yaw, pitch = (_rounded(rng.uniform(*span), "angle_deg") for span in (views.yaw_deg, views.pitch_deg))
        margin = _rounded(rng.uniform(*views.margin), "margin")
        low, high = (math.log(scale) for scale in views.density_scale)
        scale = _rounded(math.exp(rng.uniform(low, high)), "density_scale")
        size = int(rng.choice(views.sizes_px))
        yield _view(grid, views, yaw, pitch, margin, max(scale, 0.01), size, size)


def _rounded(value: float, kind: str) -> float:
    step = _FINEST[kind]
    return round(round(value / step) * step, 6)


def _view(
    grid: Grid, lens: _Lens, yaw: float, pitch: float, margin: float, density_scale: float, width: int, height: int
) -> DatasetView:
    lens_and_place: dict[str, Any] = {
        "kind": lens.kind,
        "fov_deg": lens.fov_deg,
        "yaw_deg": yaw,
        "pitch_deg": pitch,
        "margin": margin,
        "width_px": width,
        "height_px": height,
    }
    return DatasetView(**lens_and_place, density_scale=density_scale, camera=Camera.around(grid, **lens_and_place))
