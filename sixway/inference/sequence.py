"""A sequence of relit pictures: which volumes, which camera, which lights, picture by picture."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, SixWayLightmap
from sixway.inference.bake import LightmapBaker
from sixway.inference.obstacles import Obstacles
from sixway.shading.ambient import Ambient
from sixway.shading.blend import BlendRule
from sixway.shading.colour import WHITE, SmokeColour
from sixway.shading.compose import over, shade
from sixway.shading.light import DirectionalLight, Light
from sixway.shading.remap import Remap, remapped
from sixway.shading.slab import SmokeSlab
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

    environment: lat-long picture of the sky around, linear, or None; it lights the smoke and is not seen. remap: curves
    on the maps (at the net's brightness scale, as textures hold them) and alpha. obstacles: solids among the smoke;
    lights turn around them.
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
    remap: Remap | None = None
    obstacles: Obstacles | None = None


def render(shot: Shot, baker: LightmapBaker, numbers: list[int]) -> Iterator[tuple[int, Float[np.ndarray, "h w 3"]]]:
    """Yield (picture number, linear RGB) for the pictures asked for; every picture keeps the same jitter."""
    background = np.broadcast_to(np.array(shot.background, np.float32), (shot.height_px, shot.width_px, 3))
    last = len(shot.sequence.paths) - 1
    held, frame = -1, None
    for number in numbers:
        if frame is None or held != min(number, last):
            held = min(number, last)
            frame = shot.sequence.read(held)
        yield number, _picture(shot, baker, frame, number, background)


def _picture(
    shot: Shot, baker: LightmapBaker, frame: DensityFrame, number: int, background: Float[np.ndarray, "h w 3"]
) -> Float[np.ndarray, "h w 3"]:
    camera = camera_of(shot, number)
    lightmap, depth_m = baker.bake_with_depth(frame, camera, seed=0)
    surface = SmokeSurface.from_depth(camera, depth_m)
    turn = shot.light_turn_deg.at(number, shot.num_pictures)
    lights = [turned(light, turn, camera) for light in shot.lights]
    has_lamps = any(not isinstance(light, DirectionalLight) for light in lights)
    visible = None
    if shot.obstacles is not None:
        visible = [
            shot.obstacles.left(light, lightmap, surface, frame, baker.medium, rule=shot.rule) for light in lights
        ]
    if shot.remap is not None:
        lightmap = brightened(remapped(brightened(lightmap, baker.scale), shot.remap), 1.0 / baker.scale)
    sky = shot.environment
    smoke = shot.exposure * shade(
        lightmap,
        lights,
        rule=shot.rule,
        surface=SmokeSlab.from_frame(frame, baker.medium, camera) if has_lamps else surface,
        visible=visible,
        ambient=None if sky is None else Ambient.from_environment(sky, camera.basis, rule=shot.rule),
        colour=shot.colour,
    )
    if shot.obstacles is None:
        return over(smoke, lightmap["alpha"], background)
    return shot.obstacles.among(smoke, lightmap["alpha"], depth_m, frame, camera, background)


def brightened(lightmap: SixWayLightmap, factor: float) -> SixWayLightmap:
    """The six maps times a factor; alpha and emissive stay."""
    image = lightmap.image.copy()
    image[..., : len(DIRECTIONS)] *= np.float32(factor)
    return SixWayLightmap(channels=lightmap.channels, image=image)


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
