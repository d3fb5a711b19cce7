"""A picture's smoke as a lamp inside it needs it: behind each pixel an even slab, from the mean and spread of depth.

Light that a sprite shows comes from where its rays end in smoke. Mean and spread of that depth, and the opacity, are
those of exactly one slab of even smoke, which says how much smoke lies before a lamp, behind it and around it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.shading.shadow_volume import sample, steps_through
from sixway.shading.surface import target_plane_depth

Plane = Float[np.ndarray, "h w"]

_THINNEST, _THICKEST = 1e-3, 6.0
"""Optical depths of slabs: the eye sees no deeper, and 8 bits of alpha tell no more."""
_STEPS = 96
_ROWS = 64


@dataclass(frozen=True, kw_only=True, eq=False)
class SmokeSlab:
    """begins_m: metres along each ray of `camera`; thickness_m: > 0; optical_depth: of the slab, > 0. [h, w] each.

    albedo: of the smoke, in [0, 1]. Raises ValueError for other shapes and for values that are not finite, or not
    positive where they must be.
    """

    camera: Camera
    begins_m: Plane
    thickness_m: Plane
    optical_depth: Plane
    albedo: float = 1.0

    def __post_init__(self) -> None:
        shape = (self.camera.height_px, self.camera.width_px)
        for name in ("begins_m", "thickness_m", "optical_depth"):
            plane = getattr(self, name)
            if plane.shape != shape:
                raise ValueError(f"slab {name} has shape {plane.shape}, the camera asks for {shape}")
            if not np.isfinite(plane).all() or (name != "begins_m" and not (plane > 0.0).all()):
                raise ValueError(f"slab {name} must be finite{'' if name == 'begins_m' else ' and positive'}")
        if not 0.0 <= self.albedo <= 1.0:
            raise ValueError(f"slab albedo {self.albedo} must lie in [0, 1]")

    @classmethod
    def from_moments(
        cls, camera: Camera, alpha: Plane, mean_m: Plane, spread_m: Plane, *, albedo: float = 1.0
    ) -> "SmokeSlab":
        """The slab of that opacity whose visible depth has that mean and standard deviation [m along the ray].

        Visible means weighted by the part of the ray that ends there: density falls as exp(-s t) over [0, L]. With
        x = s L = -ln(1 - alpha), mean / L = 1 / x - 1 / (e^x - 1), (spread / L)^2 = 1 / x^2 - 1 / (2 sinh(x / 2))^2.
        alpha: in [0, 1]. spread_m: > 0, also where there is no smoke. Raises ValueError as the class does.
        """
        depth = np.clip(-np.log1p(-np.clip(alpha.astype(np.float64), 0.0, 1.0 - 1e-9)), _THINNEST, _THICKEST)
        thin = depth < 0.1  # where the closed forms cancel, their series
        safe = np.where(thin, 1.0, depth)
        mean = np.where(thin, 0.5 - depth / 12.0, 1.0 / safe - 1.0 / np.expm1(safe))
        variance = 1.0 / safe**2 - 0.25 / np.sinh(0.5 * safe) ** 2
        spread = np.sqrt(np.where(thin, 1.0 / 12.0 - depth**2 / 240.0, variance))
        thickness = spread_m / spread
        return cls(
            camera=camera,
            begins_m=mean_m - mean * thickness,
            thickness_m=thickness,
            optical_depth=depth,
            albedo=albedo,
        )

    @classmethod
    def from_frame(cls, frame: DensityFrame, medium: Medium, camera: Camera) -> "SmokeSlab":
        """The slabs of a volume, from one march of 96 steps a ray; solids are left out.

        Raises ValueError for an albedo of three colours.
        """
        sigma_t = frame.density * np.float32(medium.extinction_per_m)
        origins, towards = camera.rays()
        rows = range(0, camera.height_px, _ROWS)  # in bands: all points of a large picture are gigabytes
        parts = []
        for row in rows:
            band = slice(row, row + _ROWS)
            points, step_m = steps_through(origins[band], towards[band], frame.grid, _STEPS)
            thickness = sample(sigma_t, frame.grid, points) * step_m[..., None]
            at = ((points - origins[band][..., None, :]) * towards[band][..., None, :]).sum(axis=-1)
            ends = np.exp(thickness - np.cumsum(thickness, axis=-1)) * -np.expm1(-thickness)
            alpha = ends.sum(axis=-1)
            share = ends / np.maximum(alpha, 1e-12)[..., None]
            mean = (share * at).sum(axis=-1)
            variance = (share * (at - mean[..., None]) ** 2).sum(axis=-1) + step_m**2 / 12.0  # within a step, too
            parts.append(np.stack([alpha, mean, np.sqrt(variance)]))
        alpha, mean, spread = np.concatenate(parts, axis=1)
        empty = alpha < 1e-6
        return cls.from_moments(
            camera,
            alpha,
            np.where(empty, target_plane_depth(camera), mean),
            np.where(empty, frame.grid.voxel_size_m, spread),
            albedo=medium.grey_albedo,
        )

    @property
    def extinction_per_m(self) -> Plane:
        """Of the slab's even smoke [1/m], [h, w]."""
        return self.optical_depth / self.thickness_m
