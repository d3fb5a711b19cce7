"""Where a picture's smoke stands in the world: a shell at the depth at which each ray meets it first."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera


@dataclass(frozen=True, kw_only=True, eq=False)
class SmokeSurface:
    """points_m: [h, w, 3] world points, one a pixel, as `camera` sees them; all finite."""

    camera: Camera
    points_m: Float[np.ndarray, "h w 3"]

    def __post_init__(self) -> None:
        shape = (self.camera.height_px, self.camera.width_px, 3)
        if self.points_m.shape != shape:
            raise ValueError(f"surface points have shape {self.points_m.shape}, the camera asks for {shape}")

    @classmethod
    def from_depth(cls, camera: Camera, depth_m: Float[np.ndarray, "h w"]) -> "SmokeSurface":
        """depth_m: metres along each ray, as `GuideMap.depth_m`; where it is infinite, the plane through the
        camera's target stands in. Raises ValueError for another shape, NaN or depths below 0."""
        if depth_m.shape != (camera.height_px, camera.width_px):
            raise ValueError(f"depth has shape {depth_m.shape}, the camera {(camera.height_px, camera.width_px)}")
        if not (depth_m >= 0.0).all():
            raise ValueError("depth_m must hold no NaN and nothing below 0; infinite means no smoke")
        origins, towards = camera.rays()
        depth = np.where(np.isfinite(depth_m), depth_m, target_plane_depth(camera))
        return cls(camera=camera, points_m=origins + depth[..., None] * towards)

    @property
    def depth_m(self) -> Float[np.ndarray, "h w"]:
        """Metres along each ray."""
        origins, towards = self.camera.rays()
        return ((self.points_m - origins) * towards).sum(axis=-1)


def target_plane_depth(camera: Camera) -> Float[np.ndarray, "h w"]:
    """Metres along each ray to the plane through the camera's target that faces it."""
    return camera.distance_m / -(camera.rays()[1] @ np.array(camera.to_viewer))


def project(
    camera: Camera, points_m: Float[np.ndarray, "*n 3"]
) -> tuple[Float[np.ndarray, "*n 2"], Float[np.ndarray, "*n"]]:
    """Pixels (right, down; centres at halves) that see world points, and their depths along the ray [m].

    Points behind a pinhole have a depth below 0 and no meaningful pixel.
    """
    offset = (points_m - np.array(camera.target_m)) @ camera.basis.T
    across, up, towards = offset[..., 0], offset[..., 1], offset[..., 2]
    ahead = camera.distance_m - towards
    if camera.kind == "perspective":
        scale = camera.distance_m / np.where(ahead > 0.0, ahead, np.nan)
        depth = np.linalg.norm(points_m - np.array(camera.position_m), axis=-1) * np.sign(ahead)
    else:
        scale = np.ones_like(ahead)
        depth = ahead
    u = 0.5 * (across * scale / camera.half_width_m + 1.0) * camera.width_px
    v = 0.5 * (1.0 - up * scale / camera.half_height_m) * camera.height_px
    return np.stack([u, v], axis=-1), depth
