"""Shadows of solids inside the smoke: how much of the light that a ray gathers comes from its lit parts.

Six-way maps hold the light that the whole of a ray scatters to the camera when nothing stands in its way. Marching
the ray once more, coarsely, tells which parts of it count (density, what the camera sees of it, what the light
reaches of it) and which of those a solid shadows. Light that has scattered twice fills shadows with what comes from
around; its part is what the maps hold beyond the single scattering that the march finds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, map_coordinates

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.core.solids import Solid
from sixway.shading.light import Light
from sixway.shading.shadow_map import ShadowMap, light_camera, shadow_map, visible_points
from sixway.shading.surface import project

_SPREAD_CELLS = 32
"""Longest side of the grid on which twice scattered light is spread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class March:
    """Points along the camera's rays. points_m: [h, w, n, 3]. seen: [h, w, n] part of the camera's ray that ends
    there. arrives: [h, w, n] part of the light that comes there when no solid stands in its way."""

    points_m: Float[np.ndarray, "h w n 3"]
    seen: Float[np.ndarray, "h w n"]
    arrives: Float[np.ndarray, "h w n"]

    @property
    def once(self) -> Float[np.ndarray, "h w n"]:
        """What each point adds to M = pi L / E by single scattering; isotropic, albedo 1."""
        return 0.25 * self.seen * self.arrives


def shadowed_share(
    light: Light,
    solids: Sequence[Solid],
    frame: DensityFrame,
    medium: Medium,
    camera: Camera,
    *,
    arrived: Float[np.ndarray, "h w"] | None = None,
    steps: int = 48,
    cells: int = 64,
    softness_m: float = 0.0,
) -> Float[np.ndarray, "h w"]:
    """What the solids leave of the light of each pixel, in [0, 1]: what `shade` takes as `visible`.

    arrived: the weighted sum of the maps for this light with no solids; what it holds beyond single scattering is
    taken for light that scattered twice and shadowed softly. Without it all is taken for single scattering.
    steps: along each ray of the camera. cells: the light's grid, cells^2 rays of as many steps. Raises ValueError
    as `shadow_map` does.
    """
    shadow = shadow_map(light, solids, frame.grid, camera)
    sigma_t = frame.density * np.float32(medium.extinction_per_m)
    to_light = LightDepth(light, sigma_t, frame.grid, camera, cells=cells)
    march = march_rays(sigma_t, frame.grid, camera, to_light, steps=steps)
    once = march.once
    lit = visible_points(shadow, march.points_m, softness_m=softness_m)
    direct = _share(once, lit)
    if arrived is None:
        return direct
    spread = _share(*_spread(shadow, sigma_t, frame.grid, to_light, march, softness_m))
    part = np.clip(once.sum(axis=-1) / np.maximum(arrived, 1e-6), 0.0, 1.0)
    return part * direct + (1.0 - part) * spread


def _share(weight: Float[np.ndarray, "h w n"], lit: Float[np.ndarray, "h w n"]) -> Float[np.ndarray, "h w"]:
    """The lit part of the weight along each ray; 1 where there is none."""
    total = weight.sum(axis=-1)
    return np.where(total > 1e-9, (weight * lit).sum(axis=-1) / np.maximum(total, 1e-9), 1.0)


def march_rays(
    sigma_t: Float[np.ndarray, "z y x"], grid: Grid, camera: Camera, to_light: "LightDepth", *, steps: int
) -> March:
    """The camera's rays through the smoke's box, in even steps."""
    origins, towards = camera.rays()
    points, step_m = steps_through(origins, towards, grid, steps)
    thickness = sample(sigma_t, grid, points) * step_m[..., None]
    before = np.cumsum(thickness, axis=-1) - thickness
    seen = np.exp(-before) * (1.0 - np.exp(-thickness))
    return March(points_m=points, seen=seen, arrives=np.exp(-to_light.at(points)))


def _spread(
    shadow: ShadowMap,
    sigma_t: Float[np.ndarray, "z y x"],
    grid: Grid,
    to_light: "LightDepth",
    march: March,
    softness_m: float,
) -> tuple[Float[np.ndarray, "h w n"], Float[np.ndarray, "h w n"]]:
    """Weight and lit part of light that comes to the march's points from one scattering near by.

    Once scattered light goes about one mean free path: on a coarse grid it is blurred by that much, with and
    without the solids.
    """
    longest = max(grid.extent_m)
    z, y, x = (max(4, round(_SPREAD_CELLS * edge / longest)) for edge in reversed(grid.extent_m))
    cell_m = np.array(grid.extent_m) / (x, y, z)
    k, j, i = np.indices((z, y, x))
    points = np.array(grid.origin_m) + (np.stack([i, j, k], axis=-1) + 0.5) * cell_m
    sigma = sample(sigma_t, grid, points)
    source = sigma * np.exp(-to_light.at(points))
    lit = source * visible_points(shadow, points, softness_m=softness_m)
    free_path_m = sigma.sum() / max(float((sigma**2).sum()), 1e-12)  # where most of the smoke is
    blur = free_path_m / cell_m[::-1]
    index = np.moveaxis(((march.points_m - np.array(grid.origin_m)) / cell_m - 0.5)[..., ::-1], -1, 0)
    comes, comes_lit = (
        map_coordinates(gaussian_filter(field, blur, mode="constant"), index, order=1, mode="nearest")
        for field in (source, lit)
    )
    return march.seen * comes, np.where(comes > 1e-9, comes_lit / np.maximum(comes, 1e-9), 1.0)


def steps_through(
    origins: Float[np.ndarray, "h w 3"], towards: Float[np.ndarray, "h w 3"], grid: Grid, steps: int
) -> tuple[Float[np.ndarray, "h w n 3"], Float[np.ndarray, "h w"]]:
    """Midpoints of even steps through the grid's bounding box, and their length [m]; 0 for rays that miss it."""
    low = np.array(grid.origin_m)
    slope = np.where(np.abs(towards) < 1e-12, 1e-12, towards)
    one, two = (low - origins) / slope, (low + np.array(grid.extent_m) - origins) / slope
    enter = np.maximum(np.minimum(one, two).max(axis=-1), 0.0)
    leave = np.maximum(np.maximum(one, two).min(axis=-1), enter)
    step_m = (leave - enter) / steps
    at = enter[..., None] + step_m[..., None] * (np.arange(steps) + 0.5)
    return origins[..., None, :] + at[..., None] * towards[..., None, :], step_m


def sample(
    field: Float[np.ndarray, "z y x"], grid: Grid, points_m: Float[np.ndarray, "*n 3"]
) -> Float[np.ndarray, "*n"]:
    """The field at world points, between voxel centres; 0 outside."""
    index = (points_m - np.array(grid.origin_m)) / grid.voxel_size_m - 0.5
    return map_coordinates(field, np.moveaxis(index[..., ::-1], -1, 0), order=1, mode="grid-constant", cval=0.0)


class LightDepth:
    """Optical depth from any point of the smoke to the light: running sums along cells^2 rays of the light."""

    def __init__(
        self, light: Light, sigma_t: Float[np.ndarray, "z y x"], grid: Grid, camera: Camera, *, cells: int
    ) -> None:
        self._eye = light_camera(light, (), grid, camera, size_px=cells)
        self._near_m = self._eye.distance_m - grid.radius_m
        self._step_m = 2.0 * grid.radius_m / cells
        origins, towards = self._eye.rays()
        at = self._near_m + self._step_m * (np.arange(cells) + 0.5)
        sigma = sample(sigma_t, grid, origins[..., None, :] + at[:, None] * towards[..., None, :])
        self._running = self._step_m * (np.cumsum(sigma, axis=-1) - 0.5 * sigma)  # up to the middle of each step

    def at(self, points_m: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        pixels, depth = project(self._eye, points_m)
        index = np.stack([pixels[..., 1] - 0.5, pixels[..., 0] - 0.5, (depth - self._near_m) / self._step_m - 0.5])
        return map_coordinates(self._running, index, order=1, mode="nearest")
