"""Where things are: the grid of a volume and the camera that looks at it."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A world-aligned box of cubic voxels; voxel (i, j, k) is centred at origin + (ijk + 0.5) * size.

    shape_zyx: voxels along z, y, x. voxel_size_m: edge of a voxel [m].
    origin_m: the (x, y, z) corner with the smallest coordinates [m].
    Raises ValueError for an empty shape or a voxel size that is not positive and finite.
    """

    shape_zyx: tuple[int, int, int]
    voxel_size_m: float
    origin_m: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.shape_zyx) != 3 or min(self.shape_zyx) < 1:
            raise ValueError(f"grid shape {self.shape_zyx} must be three sizes of at least 1 voxel")
        if not (math.isfinite(self.voxel_size_m) and self.voxel_size_m > 0.0):
            raise ValueError(f"voxel size {self.voxel_size_m} m must be positive and finite")
        if not all(map(math.isfinite, self.origin_m)):
            raise ValueError(f"grid origin {self.origin_m} must be finite")

    @classmethod
    def centred(cls, shape_zyx: tuple[int, int, int], *, longest_edge_m: float = 1.0) -> "Grid":
        """The grid of that shape whose longest edge has that length, centred on the world's origin."""
        size = longest_edge_m / max(shape_zyx)
        z, y, x = shape_zyx
        return cls(
            shape_zyx=shape_zyx,
            voxel_size_m=size,
            origin_m=(-0.5 * x * size, -0.5 * y * size, -0.5 * z * size),
        )

    @property
    def extent_m(self) -> Vector:
        """Edge lengths of the box along x, y, z [m]."""
        z, y, x = self.shape_zyx
        return (x * self.voxel_size_m, y * self.voxel_size_m, z * self.voxel_size_m)

    @property
    def centre_m(self) -> Vector:
        x, y, z = (o + 0.5 * e for o, e in zip(self.origin_m, self.extent_m, strict=True))
        return (x, y, z)

    @property
    def radius_m(self) -> float:
        """Radius of the bounding sphere [m]."""
        return 0.5 * math.hypot(*self.extent_m)


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole or orthographic camera, described where it looks rather than where it stands.

    target_m: the world point at the centre of the image. right, up: world unit vectors of the
    image's axes. distance_m: from the target back to the camera. half_height_m: half the height of
    the image where it cuts the target; for a pinhole the field of view follows from it.
    """

    kind: Literal["orthographic", "perspective"]
    target_m: Vector
    right: Vector
    up: Vector
    distance_m: float
    half_height_m: float
    width_px: int
    height_px: int

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 1:
            raise ValueError(f"image of {self.width_px} x {self.height_px} px must be at least 1 x 1")
        if not (self.distance_m > 0.0 and self.half_height_m > 0.0):
            raise ValueError(
                f"camera distance {self.distance_m} m and half height {self.half_height_m} m must be positive"
            )
        basis = np.array([self.right, self.up])
        if not np.allclose(basis @ basis.T, np.eye(2), atol=1e-5):
            raise ValueError(f"camera right {self.right} and up {self.up} must be orthonormal")

    @classmethod
    def around(
        cls,
        grid: Grid,
        *,
        yaw_deg: float = 0.0,
        pitch_deg: float = 0.0,
        kind: Literal["orthographic", "perspective"] = "perspective",
        fov_deg: float = 30.0,
        margin: float = 1.0,
        width_px: int = 128,
        height_px: int = 128,
    ) -> "Camera":
        """A camera that frames the bounding sphere of `grid`, so no view crops the volume.

        At yaw 0 it stands at +z and looks along -z; yaw turns it towards +x, pitch lifts it.
        margin: >= 1 leaves a border around the sphere. fov_deg: full angle of the shorter image side.
        """
        if not -90.0 < pitch_deg < 90.0:
            raise ValueError(f"camera pitch {pitch_deg} deg must lie strictly between -90 and 90")
        if not 1.0 <= fov_deg <= 120.0:
            raise ValueError(f"field of view {fov_deg} deg must lie in [1, 120]")
        if min(width_px, height_px) < 1:
            raise ValueError(f"image of {width_px} x {height_px} px must be at least 1 x 1")
        yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
        right = (math.cos(yaw), 0.0, -math.sin(yaw))
        up = (-math.sin(yaw) * math.sin(pitch), math.cos(pitch), -math.cos(yaw) * math.sin(pitch))
        radius = grid.radius_m * margin
        if kind == "perspective":
            half_angle = math.radians(0.5 * fov_deg)
            distance = radius / math.sin(half_angle)
            half_short = distance * math.tan(half_angle)
        else:
            distance, half_short = 2.0 * radius, radius
        return cls(
            kind=kind,
            target_m=grid.centre_m,
            right=right,
            up=up,
            distance_m=distance,
            half_height_m=half_short * max(1.0, height_px / width_px),
            width_px=width_px,
            height_px=height_px,
        )

    @classmethod
    def perspective(
        cls,
        *,
        position_m: Vector,
        target_m: Vector,
        up: Vector = (0.0, 1.0, 0.0),
        fov_deg: float = 30.0,
        width_px: int = 128,
        height_px: int = 128,
    ) -> "Camera":
        """A pinhole camera at `position_m` that looks at `target_m`; `up` is only roughly up.

        fov_deg: full angle of the shorter image side. Raises ValueError if position, target and up lie on a line.
        """
        if not 1.0 <= fov_deg <= 120.0:
            raise ValueError(f"field of view {fov_deg} deg must lie in [1, 120]")
        distance = math.dist(position_m, target_m)
        half_short = distance * math.tan(math.radians(0.5 * fov_deg))
        return cls._placed("perspective", position_m, target_m, up, half_short, width_px, height_px)

    @classmethod
    def orthographic(
        cls,
        *,
        position_m: Vector,
        target_m: Vector,
        up: Vector = (0.0, 1.0, 0.0),
        size_m: float = 1.0,
        width_px: int = 128,
        height_px: int = 128,
    ) -> "Camera":
        """A camera with parallel rays whose image's shorter side shows `size_m`; else as `perspective`."""
        return cls._placed("orthographic", position_m, target_m, up, 0.5 * size_m, width_px, height_px)

    @classmethod
    def _placed(
        cls,
        kind: Literal["orthographic", "perspective"],
        position_m: Vector,
        target_m: Vector,
        up: Vector,
        half_short_m: float,
        width_px: int,
        height_px: int,
    ) -> "Camera":
        if min(width_px, height_px) < 1:
            raise ValueError(f"image of {width_px} x {height_px} px must be at least 1 x 1")
        to_viewer = np.array(position_m, np.float64) - target_m
        side = np.cross(up, to_viewer)
        scale = float(np.linalg.norm(to_viewer) * np.linalg.norm(up))
        if not (math.isfinite(scale) and float(np.linalg.norm(side)) > 1e-6 * scale):
            raise ValueError(
                f"camera position {position_m}, target {target_m} and up {up} leave no direction to the right; "
                "move the camera off its target or choose another up"
            )
        side /= np.linalg.norm(side)
        distance = float(np.linalg.norm(to_viewer))
        upright = np.cross(to_viewer / distance, side)
        return cls(
            kind=kind,
            target_m=target_m,
            right=(float(side[0]), float(side[1]), float(side[2])),
            up=(float(upright[0]), float(upright[1]), float(upright[2])),
            distance_m=distance,
            half_height_m=half_short_m * max(1.0, height_px / width_px),
            width_px=width_px,
            height_px=height_px,
        )

    @property
    def to_viewer(self) -> Vector:
        """World unit vector from the target towards the camera: the camera frame's +z."""
        x, y, z = np.cross(self.right, self.up)
        return (float(x), float(y), float(z))

    @property
    def basis(self) -> Float[np.ndarray, "3 3"]:
        """Rows are the camera's right, up and to_viewer in world coordinates."""
        return np.array([self.right, self.up, self.to_viewer])

    @property
    def position_m(self) -> Vector:
        x, y, z = np.array(self.target_m) + self.distance_m * np.array(self.to_viewer)
        return (float(x), float(y), float(z))

    @property
    def half_width_m(self) -> float:
        return self.half_height_m * self.width_px / self.height_px

    @property
    def pixel_m(self) -> float:
        """Edge of a pixel at the target [m]."""
        return 2.0 * self.half_height_m / self.height_px

    def to_world(self, vector: Vector) -> Vector:
        """A camera-frame vector, such as a `to_light`, in world coordinates."""
        x, y, z = np.array(vector) @ self.basis
        return (float(x), float(y), float(z))

    def rays(self) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 3"]]:
        """Origins [m] and unit vectors away from the camera through every pixel centre, float64."""
        u = (np.arange(self.width_px) + 0.5) / self.width_px * 2.0 - 1.0
        v = 1.0 - (np.arange(self.height_px) + 0.5) / self.height_px * 2.0
        right, up, to_viewer = self.basis
        on_plane = u[None, :, None] * self.half_width_m * right + v[:, None, None] * self.half_height_m * up
        if self.kind == "orthographic":
            origins = np.array(self.position_m) + on_plane
            return origins, np.broadcast_to(-to_viewer, origins.shape).copy()
        forward = on_plane - self.distance_m * to_viewer
        forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
        return np.broadcast_to(np.array(self.position_m), forward.shape).copy(), forward

    def resized(self, width_px: int, height_px: int) -> "Camera":
        """The same view at another resolution; a different aspect widens or narrows the image."""
        return replace(self, width_px=width_px, height_px=height_px)


SUBPIXELS = 4
"""References look at every pixel through a regular division into 4 x 4, unless it is much smaller than a voxel."""

_SMALL_PIXEL_VOXELS = 0.75


def enough_divisions(grid: Grid, camera: Camera) -> int:
    """Sub-pixels along a pixel's edge for a march in steps of a voxel: half as many where pixels are small.

    2 x 2 differ from 8 x 8 by 0.1 % of the mean where a pixel is 0.65 voxels wide (4 x 4: 0.02 %).
    """
    return SUBPIXELS if camera.pixel_m > _SMALL_PIXEL_VOXELS * grid.voxel_size_m else SUBPIXELS // 2


def parse_size(text: str) -> tuple[int, int]:
    """``N`` or ``WxH`` in px, 1 to 8192; raises ValueError."""
    parts = text.lower().split("x")
    if len(parts) > 2 or not all(part.isdigit() and 1 <= int(part) <= 8192 for part in parts):
        raise ValueError(f"size {text!r} is not N or WxH with sides of 1 to 8192 px")
    return int(parts[0]), int(parts[-1])
