"""The camera and its six lights as the kernels take them."""

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.core.conventions import TO_LIGHT
from sixway.core.frames import Camera, Grid, Vector
from sixway.guide.ray_kernels import View

_SMALLEST_DEPTH = 1e-3
"""Depth 0 means empty, so the nearest smoke keeps a value above it."""


def to_light_in_world(name: str, camera: Camera, vertical: str) -> Vector:
    """World unit vector towards a surrogate light, under the chosen reading of top and bottom.

    Raises ValueError for `omega_cross_z` where the camera looks along the world's z axis.
    """
    if name not in ("top", "bottom") or vertical == "camera_up":
        return camera.to_world(TO_LIGHT[name])
    if vertical == "world_up":
        axis = np.array([0.0, 1.0, 0.0])
    else:
        axis = np.cross(camera.to_viewer, (0.0, 0.0, 1.0))
        length = float(np.linalg.norm(axis))
        if length < 1e-4:
            raise ValueError(
                "guide.vertical omega_cross_z is undefined for a camera that looks along the world's z axis; "
                "use camera_up or another yaw"
            )
        axis = axis / length
    x, y, z = axis if name == "top" else -axis
    return (float(x), float(y), float(z))


def view_of(camera: Camera, grid: Grid) -> View:
    """The camera as the kernels take it: metres relative to the grid's corner."""
    right, up, to_viewer = camera.basis
    view = View()
    view.position_m = wp.vec3(*(np.array(camera.position_m) - np.array(grid.origin_m)))
    view.to_target_m = wp.vec3(*(-camera.distance_m * to_viewer))
    view.right_m = wp.vec3(*(camera.half_width_m * right))
    view.up_m = wp.vec3(*(camera.half_height_m * up))
    view.perspective = int(camera.kind == "perspective")
    view.height_px, view.width_px = camera.height_px, camera.width_px
    return view


def normalised_depth(depth_m: Float[np.ndarray, "h w"], camera: Camera, grid: Grid) -> Float[np.ndarray, "h w"]:
    """Metric depth to (0, 1] between the near and far end of the bounding sphere; 0 where empty."""
    offset = np.array(grid.centre_m) - np.array(camera.position_m)
    near = abs(float(offset @ np.array(camera.to_viewer))) - grid.radius_m
    if camera.kind == "perspective":
        near = float(np.linalg.norm(offset)) - grid.radius_m
    scaled = np.clip((depth_m - near) / (2.0 * grid.radius_m), _SMALLEST_DEPTH, 1.0)
    return np.where(np.isfinite(depth_m), scaled, 0.0).astype(np.float32)
