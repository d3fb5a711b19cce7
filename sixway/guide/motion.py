"""How smoke moves in the image: the simulator's wind, projected and weighted by what the eye sees.

A translucent volume has no single flow: layers move apart behind one pixel. Its mean along the ray is what a flow
field can say, and the variance tells how little that is.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.bands import RowBands
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide.motion_kernels import march_motion
from sixway.guide.smoke import upload
from sixway.guide.views import view_of


@dataclass(frozen=True)
class ImageMotion:
    """Motion of the smoke behind each pixel, weighted by the opacity that the camera sees of it.

    mean: [px/frame; right, down]. variance: of each of the two along the ray [px^2/frame^2]; their covariance is left
    out. Both 0 where there is no smoke. alpha: 1 - transmittance, the weight of the pixel.
    """

    mean: Float[np.ndarray, "h w 2"]
    variance: Float[np.ndarray, "h w 2"]
    alpha: Float[np.ndarray, "h w"]


def project_motion(
    frame: DensityFrame, camera: Camera, medium: Medium, *, frame_s: float, device: str, threads: int = 1
) -> Float[np.ndarray, "h w 2"]:
    """Mean image motion during `frame_s` seconds, [px/frame; right, down]; see `project_motion_statistics`."""
    return project_motion_statistics(frame, camera, medium, frame_s=frame_s, device=device, threads=threads).mean


def project_motion_statistics(
    frame: DensityFrame, camera: Camera, medium: Medium, *, frame_s: float, device: str, threads: int = 1
) -> ImageMotion:
    """Image motion during `frame_s` seconds: the speed at this moment times that time. Obstacles hide smoke.

    Raises ValueError if the frame has no velocity.
    """
    if frame.velocity_m_s is None:
        raise ValueError("this frame has no velocity, so its motion in the image is unknown; simulate it with one")
    size = (camera.height_px, camera.width_px)
    on_device = wp.get_device(device)
    bands = RowBands(on_device, threads=threads)
    smoke = upload(frame, medium, mip=1, emission=False, device=on_device, bands=bands)
    if smoke is None:
        still = np.zeros((*size, 2), np.float32)
        return ImageMotion(mean=still, variance=still.copy(), alpha=np.zeros(size, np.float32))
    mean, variance = (wp.empty(size, dtype=wp.vec2, device=on_device) for _ in range(2))
    alpha = wp.empty(size, dtype=float, device=on_device)
    bands.launch(
        march_motion,
        dim=size,
        inputs=[
            view_of(camera, frame.grid),
            smoke.volume,
            wp.array(frame.velocity_m_s, dtype=wp.vec3, device=on_device),
            frame.grid.extent_m[0] / frame.velocity_m_s.shape[2],
            frame_s,
        ],
        outputs=[mean, variance, alpha],
    )
    return ImageMotion(mean=mean.numpy(), variance=variance.numpy(), alpha=alpha.numpy())
