"""What fire adds to a picture, behind and among its own smoke: an absorption-emission march.

Every step is a homogeneous slab, dL = T eps (1 - exp(-sigma_t h)) / sigma_t, the radiance of an emitter
eps [1/m] that its own smoke absorbs (Chandrasekhar 1960, section 7). What smoke scatters of this light is a map
of its own: `sixway.reference.self_lit`.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.kernels import Box
from sixway.reference.media import cropped_to_fire
from sixway.reference.view import View, grid_on_device

_CUTOFF = 1e-4


def with_emissive(
    image: Float[np.ndarray, "h w 7"], frame: DensityFrame, camera: Camera, medium: Medium
) -> Float[np.ndarray, "h w c"]:
    """The image with the channel of the frame's emission appended, if the frame has one."""
    if frame.emission is None:
        return image
    return np.concatenate([image, march_emission(frame, camera, medium)[..., None]], axis=-1)


def march_emission(frame: DensityFrame, camera: Camera, medium: Medium) -> Float[np.ndarray, "h w"]:
    """Radiance of the frame's emission in every pixel, float32; solid obstacles hide what is behind them."""
    extinction = cropped_to_fire(frame, medium)
    if extinction is None:
        return np.zeros((camera.height_px, camera.width_px), np.float32)
    view = View(extinction, camera)
    dark = np.zeros_like(extinction.sigma_t)
    fields = grid_on_device(extinction.sigma_t, extinction.solid, extinction.emission, dark)
    return view.image([radiance(fields, view.box, *view.march_rays(), albedo=0.0)])[..., 0]


@dr.syntax
def radiance(fields, box: Box, origin, ray, offset, *, albedo):
    """What arrives at `origin` from along `ray`, first looked at `offset` of a voxel behind it.

    fields: a texture of sigma_t, solid, emission and light that the smoke scatters, all of it a source:
    eps = emission + albedo sigma_t scattered.
    """
    near, far = box.span(origin, ray)
    distance = near + offset * box.voxel
    transmittance = mi.Float(1)
    total = mi.Float(0)
    active = distance < far
    while active:
        sigma_t, solid, emission, scattered = fields.eval(box.to_texture(origin + distance * ray))
        depth = sigma_t * box.voxel
        passed = dr.exp(-depth)
        length = dr.select(depth > 1e-3, (1.0 - passed) / depth, 1.0 - 0.5 * depth) * box.voxel
        blocked = solid > 0.5
        source = emission + albedo * sigma_t * scattered
        total += dr.select(blocked, 0.0, transmittance * source * length)
        transmittance *= passed
        distance += box.voxel
        active = (distance < far) & (transmittance > _CUTOFF) & ~blocked
    return total
