"""A ball lit from six sides, in closed form: a picture in which every channel must sit where it belongs."""

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS, TO_LIGHT


def axis_ball(size_px: int, *, radius: float = 0.8, softness: float = 0.1) -> Float[np.ndarray, "h w 8"]:
    """Six-way maps of a white Lambertian ball, channels `LIGHTMAP_CHANNELS`, premultiplied and linear.

    M = max(0, n . to_light): 1 where the surface faces the light. n is the normal that the viewer sees, so
    the light from behind is seen through the rim only: there M = 1 - n_z, which a cloud's silver lining is
    like. alpha falls from 1 to 0 over the outer `softness` of the radius; emissive is a spot in the upper
    right quarter, so that no flip or turn of the picture goes unseen. radius: in half widths of the picture.
    Raises ValueError for a ball that does not fit.
    """
    if not (size_px >= 8 and 0.0 < radius <= 1.0 and 0.0 < softness <= 1.0):
        raise ValueError(
            f"ball of radius {radius}, softness {softness} in {size_px} px: needs 8 px and values in (0, 1]"
        )
    centre = (np.arange(size_px, dtype=np.float64) + 0.5) / size_px * 2.0 - 1.0
    x, y = np.meshgrid(centre / radius, -centre / radius)  # row 0 is on top
    r = np.minimum(np.hypot(x, y), 1.0)
    normal = np.stack([x, y, np.sqrt(1.0 - r * r)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    alpha = np.clip((1.0 - np.hypot(x, y)) / softness, 0.0, 1.0)
    planes = {name: np.maximum(normal @ np.array(TO_LIGHT[name]), 0.0) * alpha for name in DIRECTIONS}
    planes["back"] = (1.0 - normal[..., 2]) * alpha
    planes["alpha"] = alpha
    planes["emissive"] = np.exp(-20.0 * ((x - 0.4) ** 2 + (y - 0.4) ** 2)) * alpha
    return np.stack([planes[name] for name in LIGHTMAP_CHANNELS], axis=-1).astype(np.float32)
