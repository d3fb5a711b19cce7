"""Smoke among other things: what solids in front hide of it, where it touches them, and what shows through."""

import numpy as np
from jaxtyping import Float

from sixway.shading.compose import over

Plane = Float[np.ndarray, "h w"]


def part_in_front(smoke_depth_m: Plane, scene_depth_m: Plane, thickness_m: float | Plane) -> Plane:
    """The part of a ray's smoke before a surface at `scene_depth_m` (infinite: none), in [0, 1].

    The smoke begins at `smoke_depth_m` (infinite: none, as in `GuideMap.depth_m`) and is taken for even over
    `thickness_m` > 0: the width over which a soft particle fades where it meets a wall. Raises ValueError for a
    thickness that is not positive.
    """
    if not np.all(np.asarray(thickness_m) > 0.0):
        raise ValueError("thickness_m must be positive; a small one cuts smoke off sharply")
    begins = np.where(np.isfinite(smoke_depth_m), smoke_depth_m, 0.0)
    part = np.clip((scene_depth_m - begins) / thickness_m, 0.0, 1.0)
    return np.where(np.isfinite(smoke_depth_m), part, np.isinf(scene_depth_m).astype(np.float64))


def cut_off(
    premultiplied: Float[np.ndarray, "h w 3"], alpha: Plane, part: Plane
) -> tuple[Float[np.ndarray, "h w 3"], Plane]:
    """Colour and alpha of that part of each ray's smoke: alpha' = 1 - (1 - alpha)^part (Beer-Lambert), colour alike.

    Engines fade linearly with the part instead, which is too thin by up to alpha's curve.
    """
    transmittance = np.maximum(1.0 - alpha, 0.0)
    kept = np.where(part > 0.0, 1.0 - transmittance ** np.maximum(part, 1e-12), 0.0)
    share = np.where(alpha > 1e-5, kept / np.maximum(alpha, 1e-5), part)
    return premultiplied * share[..., None], kept


def composed(
    premultiplied: Float[np.ndarray, "h w 3"],
    alpha: Plane,
    smoke_depth_m: Plane,
    background: Float[np.ndarray, "h w 3"],
    scene_depth_m: Plane,
    *,
    thickness_m: float | Plane,
) -> Float[np.ndarray, "h w 3"]:
    """The smoke in a picture of a scene with depth: hidden by what stands before it, fading into what it touches."""
    part = part_in_front(smoke_depth_m, scene_depth_m, thickness_m)
    return over(*cut_off(premultiplied, alpha, part), background)
