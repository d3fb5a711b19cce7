"""Shadows of solids on smoke: the light's picture of the solids, and whether a point lies behind them.

The smoke is taken for a shell at its first depth, as the paper does: quick, with no second march. What the shell
cannot know, that only a part of the smoke along a ray is in shadow, is `shadow_volume`'s.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera, Grid, Vector
from sixway.core.solids import Solid
from sixway.shading.light import DirectionalLight, Light, LineLight, PointLight, RectangleLight, SpotLight
from sixway.shading.near import middle_of
from sixway.shading.solid_depth import bounding_sphere, solid_depth
from sixway.shading.surface import SmokeSurface, project

_TAPS = 24
_WIDEST_DEG = 120.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ShadowMap:
    """camera: the light's view of the smoke's box. depth_m: to the first solid along its rays, infinite for none.

    light_size: of a sun, the width of its disc one metre away; of a lamp, its own width [m].
    """

    camera: Camera
    depth_m: Float[np.ndarray, "h w"]
    light_size: float


def shadow_map(light: Light, solids: Sequence[Solid], grid: Grid, camera: Camera, *, size_px: int = 256) -> ShadowMap:
    """The solids as `light` sees them before and in the smoke's `grid`. camera: whose frame a sun's direction is in.

    A wire or panel is seen from its centre, as wide as its longer side. Raises ValueError for a lamp so near the
    smoke that its box fills more than 120 degrees.
    """
    eye = light_camera(light, solids, grid, camera, size_px=size_px)
    return ShadowMap(camera=eye, depth_m=solid_depth(solids, eye), light_size=_size(light))


def light_camera(light: Light, solids: Sequence[Solid], grid: Grid, camera: Camera, *, size_px: int) -> Camera:
    """A square picture, `size_px` wide, of the bounding sphere of `grid` as the light sees it."""
    centre = np.array(grid.centre_m)
    if isinstance(light, DirectionalLight):
        # far enough back that every solid lies ahead
        reach = [float(np.linalg.norm(c - centre)) + r for c, r in map(bounding_sphere, solids)]
        distance = 1.01 * max([grid.radius_m, *reach])
        position = centre + distance * np.array(camera.to_world(light.to_light))
        return Camera.orthographic(
            position_m=_vector(position),
            target_m=grid.centre_m,
            up=_any_up(position - centre),
            size_m=2.0 * grid.radius_m,
            width_px=size_px,
            height_px=size_px,
        )
    position = middle_of(light)
    distance = float(np.linalg.norm(position - centre))
    fov = 2.0 * math.degrees(math.asin(min(1.0, grid.radius_m / max(distance, 1e-12))))
    if fov > _WIDEST_DEG:
        raise ValueError(
            f"{type(light).__name__} at {distance:.3g} m sees the smoke's box of radius {grid.radius_m:.3g} m under "
            f"{fov:.0f} deg; a shadow map takes up to {_WIDEST_DEG:.0f}: move the lamp away"
        )
    return Camera.perspective(
        position_m=_vector(position),
        target_m=grid.centre_m,
        up=_any_up(position - centre),
        fov_deg=max(fov, 1.0),
        width_px=size_px,
        height_px=size_px,
    )


def visible_points(
    shadow: ShadowMap, points_m: Float[np.ndarray, "*n 3"], *, softness_m: float = 0.0
) -> Float[np.ndarray, "*n"]:
    """The part of the light that world points see past the solids, in [0, 1].

    Percentage-closer filtering over a disc as wide as the penumbra: light size x (receiver - blocker) / blocker as in
    Fernando 2005 (PCSS), and `softness_m` more. Points outside the map are lit.
    """
    pixels, depth = project(shadow.camera, points_m)
    texel_m = shadow.camera.pixel_m
    lean = 1.0 if shadow.camera.kind == "orthographic" else depth / shadow.camera.distance_m
    bias = 1.5 * texel_m * lean
    per_texel = texel_m * lean  # metres that a texel covers at the point
    if shadow.light_size == 0.0 and softness_m == 0.0:
        return 1.0 - _blocked(shadow, pixels, depth - bias)[0]
    search = _penumbra(shadow, depth, _nearest_m(shadow)) + softness_m
    found, blocker = _filtered(shadow, pixels, depth - bias, search / per_texel)
    width = _penumbra(shadow, depth, blocker) + softness_m
    share, _ = _filtered(shadow, pixels, depth - bias, width / per_texel)
    return np.where(found > 0.0, 1.0 - share, 1.0)


def visibility(shadow: ShadowMap, surface: SmokeSurface, *, softness_m: float = 0.0) -> Float[np.ndarray, "h w"]:
    """`visible_points` of the smoke's shell: what `shade` takes as `visible`."""
    return visible_points(shadow, surface.points_m, softness_m=softness_m)


def _filtered(
    shadow: ShadowMap,
    pixels: Float[np.ndarray, "*n 2"],
    limit: Float[np.ndarray, "*n"],
    width_px: Float[np.ndarray, "*n"],
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """Part of a disc of that diameter that is blocked, and the blockers' mean depth (infinite without)."""
    blocked, depths = np.zeros(limit.shape), np.zeros(limit.shape)
    for tap in range(_TAPS):
        radius, turn = math.sqrt((tap + 0.5) / _TAPS), math.pi * (3.0 - math.sqrt(5.0)) * tap  # Vogel's spiral
        offset = 0.5 * radius * width_px[..., None] * np.array([math.cos(turn), math.sin(turn)])
        hit, depth = _blocked(shadow, pixels + offset, limit)
        blocked += hit
        depths += np.where(hit > 0.0, depth, 0.0)
    return blocked / _TAPS, np.where(blocked > 0.0, depths / np.maximum(blocked, 1.0), np.inf)


def _blocked(
    shadow: ShadowMap, pixels: Float[np.ndarray, "*n 2"], limit: Float[np.ndarray, "*n"]
) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
    """1 where the texel's solid lies nearer than the limit, and its depth."""
    size = np.array([shadow.camera.width_px, shadow.camera.height_px])
    inside = np.all((pixels >= 0.0) & (pixels < size), axis=-1)
    column, row = np.moveaxis(np.where(np.expand_dims(inside, -1), pixels, 0.0).astype(int), -1, 0)
    depth = shadow.depth_m[row, column]
    return (inside & (depth < limit)).astype(np.float64), depth


def _penumbra(shadow: ShadowMap, receiver: np.ndarray, blocker: np.ndarray | float) -> np.ndarray:
    """Width of the half-shadow at the receiver [m]."""
    gap = np.maximum(receiver - np.where(np.isfinite(blocker), blocker, receiver), 0.0)
    if shadow.camera.kind == "orthographic":
        return shadow.light_size * gap
    return shadow.light_size * gap / np.maximum(np.where(np.isfinite(blocker), blocker, 1.0), 1e-6)


def _nearest_m(shadow: ShadowMap) -> float:
    return float(shadow.depth_m.min())


def _size(light: Light) -> float:
    match light:
        case DirectionalLight():
            return 2.0 * math.tan(math.radians(0.5 * light.angle_deg))
        case PointLight() | SpotLight():
            return 0.0
        case LineLight():
            return math.dist(light.start_m, light.end_m)
        case RectangleLight():
            return 2.0 * max(math.hypot(*light.half_right_m), math.hypot(*light.half_up_m))


def _any_up(away: Float[np.ndarray, "3"]) -> Vector:
    """A world axis that is not along `away`: a shadow map has no roll."""
    return _vector(np.eye(3)[int(np.abs(away).argmin())])


def _vector(values: np.ndarray) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))
