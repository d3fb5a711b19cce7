"""Solids in a shot: the shadows that they cast on the smoke, and what they hide of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from PIL import Image

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.core.solids import Solid
from sixway.shading.blend import BlendRule
from sixway.shading.compose import map_of, over
from sixway.shading.light import Colour, Light
from sixway.shading.scene import cut_off, part_in_front
from sixway.shading.shadow_map import light_camera, shadow_map, visibility
from sixway.shading.shadow_volume import sample, shadowed_share
from sixway.shading.solid_depth import solid_depth
from sixway.shading.surface import SmokeSurface

Plane = Float[np.ndarray, "h w"]
Picture = Float[np.ndarray, "h w 3"]
Shadows = Literal["march", "shell"]

_MARCHED_PX = 96
"""Longest side of the picture that is marched for shadows: inside smoke they are soft."""

_SUBPIXELS = 2
"""Rays along each side of a pixel that look for solids, so that these have smooth edges."""

_STEPS = 96
"""Along a ray through the smoke's bounding sphere."""


@dataclass(frozen=True, kw_only=True)
class Obstacles:
    """Solids in the world, seen in one flat colour.

    shadows: by a march along each ray through the smoke, or on its shell as engines do, which is quicker and far less
    true (docs/shadows.md). softness_m: blurs their edges by so much. fade_m: smoke fades into a solid over so many
    metres behind its first depth, as a soft particle does; None hides what of the smoke is behind the solid.
    """

    solids: tuple[Solid, ...]
    shadows: Shadows = "march"
    softness_m: float = 0.0
    fade_m: float | None = None
    colour: Colour = (0.0, 0.0, 0.0)

    def left(
        self,
        light: Light,
        lightmap: SixWayLightmap,
        surface: SmokeSurface,
        frame: DensityFrame,
        medium: Medium,
        *,
        rule: BlendRule,
    ) -> Plane:
        """What the solids leave of the light of each pixel, in [0, 1]: what `shade` takes as `visible`.

        lightmap: as nothing has changed its values. Raises ValueError for a lamp that `check` refuses.
        """
        camera = surface.camera
        if self.shadows == "shell":
            shadow = shadow_map(light, self.solids, frame.grid, camera)
            return visibility(shadow, surface, softness_m=self.softness_m)
        shrink = min(1.0, _MARCHED_PX / max(camera.width_px, camera.height_px))
        small = camera.resized(max(1, round(shrink * camera.width_px)), max(1, round(shrink * camera.height_px)))
        share = shadowed_share(
            light,
            self.solids,
            frame,
            medium,
            small,
            arrived=_resized(map_of(light, lightmap, surface, rule)[0], small),
            softness_m=self.softness_m,
        )
        return np.clip(_resized(share, camera), 0.0, 1.0)

    def among(
        self, smoke: Picture, alpha: Plane, depth_m: Plane, frame: DensityFrame, camera: Camera, background: Picture
    ) -> Picture:
        """The smoke (linear RGB on black) before, around and behind the solids, over a background.

        depth_m: to the first smoke, infinite without, as `GuideMap` has it.
        """
        fine = camera.resized(_SUBPIXELS * camera.width_px, _SUBPIXELS * camera.height_px)
        to_solid_m = solid_depth(self.solids, fine)
        if self.fade_m is None:
            part = share_before(to_solid_m, frame, fine)
        else:
            part = part_in_front(_repeated(depth_m), to_solid_m, self.fade_m)
        behind = np.where(np.isfinite(to_solid_m)[..., None], np.array(self.colour), _repeated(background))
        picture = over(*cut_off(_repeated(smoke), _repeated(alpha), part), behind)
        blocks = picture.reshape(camera.height_px, _SUBPIXELS, camera.width_px, _SUBPIXELS, 3)
        return blocks.mean(axis=(1, 3)).astype(np.float32)

    def check(self, lights: Sequence[Light], grid: Grid, camera: Camera) -> None:
        """Raises ValueError for lamps so near the smoke that they have no shadow map."""
        for light in lights:
            light_camera(light, self.solids, grid, camera, size_px=1)


def share_before(
    depth_m: Float[np.ndarray, "h w"], frame: DensityFrame, camera: Camera, *, steps: int = _STEPS
) -> Float[np.ndarray, "h w"]:
    """The part of each ray's optical depth that lies before `depth_m` [m]; 1 where that is infinite or no smoke is."""
    grid, hit = frame.grid, np.isfinite(depth_m)
    origins, towards = (vectors[hit] for vectors in camera.rays())
    nearest_m = ((np.array(grid.centre_m) - origins) * towards).sum(axis=-1)
    step_m = 2.0 * grid.radius_m / steps
    before, whole = np.zeros(len(origins)), np.zeros(len(origins))
    for number in range(steps):
        at = nearest_m - grid.radius_m + (number + 0.5) * step_m
        density = np.where(at > 0.0, sample(frame.density, grid, origins + at[:, None] * towards), 0.0)
        before += density * np.clip((depth_m[hit] - at) / step_m + 0.5, 0.0, 1.0)
        whole += density
    part = np.ones(depth_m.shape)
    part[hit] = np.where(whole > 0.0, before / np.where(whole > 0.0, whole, 1.0), 1.0)
    return part


def _resized(plane: Plane, camera: Camera) -> Float[np.ndarray, "camera_h camera_w"]:
    """Averaged where it shrinks, interpolated where it grows."""
    size = (camera.width_px, camera.height_px)
    return np.asarray(Image.fromarray(plane.astype(np.float32)).resize(size, Image.Resampling.BILINEAR))


def _repeated(picture: np.ndarray) -> np.ndarray:
    return picture.repeat(_SUBPIXELS, axis=0).repeat(_SUBPIXELS, axis=1)
