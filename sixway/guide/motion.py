"""How smoke moves in the image: the simulator's wind, projected and averaged by what the eye sees.

A translucent volume has no single flow: this is the mean along the ray, weighted by opacity.
"""

import numpy as np
import warp as wp
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.guide import kernels
from sixway.guide.views import camera_arguments


def project_motion(
    frame: DensityFrame, camera: Camera, medium: Medium, *, frame_s: float, device: str
) -> Float[np.ndarray, "h w 2"]:
    """Image motion during `frame_s` seconds, [px/frame; right, down]; 0 where there is no smoke.

    Raises ValueError if the frame has no velocity.
    """
    if frame.velocity_m_s is None:
        raise ValueError("this frame has no velocity, so its motion in the image is unknown")
    grid = frame.grid
    size = (camera.height_px, camera.width_px)
    with wp.ScopedDevice(device):
        flow = wp.empty((*size, 2), dtype=float)
        wp.launch(
            kernels.march_motion,
            dim=size,
            inputs=[
                wp.array(frame.density, dtype=float),
                wp.array(frame.velocity_m_s, dtype=wp.vec3),
                grid.extent_m[0] / frame.velocity_m_s.shape[2],
                grid.voxel_size_m,
                wp.vec3(grid.extent_m),
                *camera_arguments(camera, grid),
                medium.extinction_per_m,
                grid.voxel_size_m,
                frame_s,
            ],
            outputs=[flow],
        )
    return flow.numpy()
