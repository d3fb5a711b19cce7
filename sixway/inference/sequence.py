"""A sequence of relit pictures: which volumes, which camera, which lights, picture by picture."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.inference.bake import LightmapBaker
from sixway.shading.ambient import Ambient
from sixway.shading.blend import BlendRule
from sixway.shading.colour import WHITE, SmokeColour
from sixway.shading.compose import over, shade
from sixway.shading.light import Light
from sixway.shading.surface import SmokeSurface
from sixway.shading.turn import turned
from sixway.volumes.sequence import VolumeSequence


@dataclass(frozen=True)
class Path1D:
    """A value that stays, or runs evenly from `first` to `last`."""

    first: float
    last: float

    @classmethod
    def parse(cls, text: str) -> "Path1D":
        """``A`` or ``A:B`` in degrees; raises ValueError."""
        parts = text.split(":")
        try:
            values = [float(part) for part in parts]
        except ValueError:
            values = []
        if not 1 <= len(values) <= 2 or not np.isfinite(values).all():
            raise ValueError(f"{text!r} is neither a number nor a path A:B of two numbers")
        return cls(values[0], values[-1])

    @property
    def moves(self) -> bool:
        return self.first != self.last

    def at(self, number: int, count: int) -> float:
        """Value for picture `number` of `count`."""
        return self.first + (self.last - self.first) * number / max(1, count - 1)


@dataclass(frozen=True, kw_only=True)
class Shot:
    """What to render. sequence: one volume, or one a picture. exposure: factor on the shaded light.

    environment: lat-long picture of the sky around, linear, or None; it lights the smoke and is not seen.
    """

    sequence: VolumeSequence
    num_pictures: int
    yaw_deg: Path1D
    pitch_deg: Path1D
    light_turn_deg: Path1D
    lights: tuple[Light, ...]
    rule: BlendRule
    exposure: float
    background: tuple[float, float, float]
    width_px: int
    height_px: int
    margin: float
    colour: SmokeColour = WHITE
    environment: Float[np.ndarray, "h w 3"] | None = None


def render(shot: Shot, baker: LightmapBaker, numbers: list[int]) -> Iterator[tuple[int, Float[np.ndarray, "h w 3"]]]:
    """Yield (picture number, linear RGB) for the pictures asked for; every picture keeps the same jitter."""
    background = np.broadcast_to(np.array(shot.background, np.float32), (shot.height_px, shot.width_px, 3))
    last = len(shot.sequence.paths) - 1
    held, frame = -1, None
    for number in numbers:
        if frame is None or held != min(number, last):
            held = min(number, last)
            frame = shot.sequence.read(held)
        camera = camera_of(shot, number)
        lightmap, depth_m = baker.bake_with_depth(frame, camera, seed=0)
        turn = shot.light_turn_deg.at(number, shot.num_pictures)
        sky = shot.environment
        smoke = shot.exposure * shade(
            lightmap,
            [turned(light, turn, camera) for light in shot.lights],
            rule=shot.rule,
            surface=SmokeSurface.from_depth(camera, depth_m),
            ambient=None if sky is None else Ambient.from_environment(sky, camera.basis, rule=shot.rule),
            colour=shot.colour,
        )
        yield number, over(smoke, lightmap["alpha"], background)


def camera_of(shot: Shot, number: int) -> Camera:
    """The camera of one picture, framing the box of the whole sequence."""
    return Camera.around(
        shot.sequence.grid,
        yaw_deg=shot.yaw_deg.at(number, shot.num_pictures),
        pitch_deg=shot.pitch_deg.at(number, shot.num_pictures),
        margin=shot.margin,
        width_px=shot.width_px,
        height_px=shot.height_px,
    )
