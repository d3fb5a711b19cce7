"""Smoke in the light of its own fire: what the smoke scatters towards the camera of the emission within it.

Light is gathered at the voxels of the smoke and kept there, one bounce after the other, then marched to the
camera as `emission.radiance` marches the fire itself. Import this after `variant.use_variant` has run.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference import kernels
from sixway.reference.emission import radiance
from sixway.reference.media import Extinction, cropped_to_fire
from sixway.reference.view import View, aligned
from sixway.reference.voxels import Voxels

_R2 = (0.7548776662466927, 0.5698402909980532)  # 1/p and 1/p^2, p^3 = p + 1 (Roberts 2018)
_CHANNELS = 4  # sigma_t, solid, emission, scattered light
_TAIL_TOLERANCE = 0.002  # of the scattered light: below it the remaining bounces are a geometric series
_MOST_BOUNCES = 200


def trace_self_lit(
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    *,
    bounces: Bounces = "paper",
    samples: int = 64,
    seed: int = 0,
) -> Float[np.ndarray, "h w"]:
    """Radiance that the smoke scatters of its fire's light, float32, in the unit of `emissive`, to be added to it.

    bounces: after the light was scattered once: ``single`` none, ``paper`` one, ``multi`` all. samples:
    directions per voxel and bounce; a small flame is met by few of them, so more are needed than for the sun.
    Zeros without fire or smoke. Raises ValueError for ``multi`` with hg_g != 0: the grid keeps no direction.
    """
    if bounces == "multi" and medium.hg_g != 0.0:
        raise ValueError(
            f"hg_g={medium.hg_g} with bounces 'multi' needs scattered light by direction, which is not kept; use "
            "bounces 'paper' or 'single'"
        )
    extinction = cropped_to_fire(frame, medium)
    if extinction is None or not extinction.sigma_t.any():
        return np.zeros((camera.height_px, camera.width_px), np.float32)
    smoke = _LitSmoke(extinction, camera, medium, samples=samples)
    newest = total = smoke.gathered(smoke.fields(burning=True, scattered=None), seed)
    orders = {"single": 0, "paper": 1, "multi": _MOST_BOUNCES}[bounces]
    energy = all_energy = _sum(newest)
    for order in range(1, orders + 1):
        newest = smoke.gathered(smoke.fields(burning=False, scattered=newest), seed + order * 0x9E3779B9)
        total = total + newest
        dr.eval(total)  # else the sum would grow into a kernel of its own for every number of bounces
        previous, energy = energy, _sum(newest)
        all_energy += energy
        ratio = min(energy / previous, 0.99) if previous > 0.0 else 0.0
        tail = ratio / (1.0 - ratio)
        if bounces == "multi" and energy * tail <= _TAIL_TOLERANCE * all_energy:
            total = total + dr.opaque(mi.Float, tail) * newest
            break
    view = smoke.view
    fields = smoke.fields(burning=False, scattered=total)
    seen = radiance(fields, view.box, *view.march_rays(), albedo=smoke.albedo)
    return view.image([dr.maximum(seen, 0.0)])[..., 0]  # sharpened light may overshoot 0


class _LitSmoke:
    """The voxels of smoke, and the light that they gather."""

    def __init__(self, extinction: Extinction, camera: Camera, medium: Medium, *, samples: int) -> None:
        self.voxels = Voxels(extinction)
        self.view = View(extinction, camera)
        self.albedo = dr.opaque(mi.Float, medium.grey_albedo)
        self._g = dr.opaque(mi.Float, medium.hg_g)
        self._samples = dr.opaque(mi.UInt32, samples)
        self._shape = (*extinction.grid.shape_zyx, _CHANNELS)
        still = np.zeros(self._shape, np.float32)
        still[..., 0], still[..., 1] = extinction.sigma_t, extinction.solid
        self._still = mi.Float(aligned(still))
        self._emission = mi.Float(aligned(extinction.emission))

    def fields(self, *, burning: bool, scattered):
        """A texture of what `emission.radiance` reads."""
        values = mi.Float(self._still)
        if burning:
            dr.scatter(values, self._emission, dr.arange(mi.UInt32, len(self._emission)) * _CHANNELS + 2)
        if scattered is not None:
            (sharp,) = self.voxels.sharpened([mi.Float(scattered)])  # a copy: it works in place
            dr.scatter(values, sharp, self.voxels.active * _CHANNELS + 3)
        return kernels.grid_texture(mi.TensorXf(values, self._shape))

    def gathered(self, fields, seed: int):
        """What every voxel scatters towards the camera, per unit of sigma_s: the mean over its directions."""
        voxels = self.voxels
        received = _gathered(
            fields,
            voxels.box,
            voxels.centres,
            self.view.to_camera(voxels.centres),
            rotation=kernels.uniform_triple(voxels.active, dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)),
            samples=self._samples,
            g=self._g,
            albedo=self.albedo,
        )
        dr.eval(received)
        return received


@dr.syntax
def _gathered(fields, box: kernels.Box, start, outgoing, *, rotation, samples, g, albedo):
    index = mi.UInt32(0)
    total = mi.Float(0)
    frame = mi.Frame3f(outgoing)
    while index < samples:
        number = mi.Float(index)
        u, v = dr.fma(number, _R2[0], rotation[0]), dr.fma(number, _R2[1], rotation[1])
        ray = -frame.to_world(kernels.sample_henyey_greenstein(u - dr.floor(u), v - dr.floor(v), g))
        total += radiance(fields, box, start, ray, 0.5, albedo=albedo)
        index += 1
    return total / mi.Float(samples)


def _sum(values) -> float:
    return float(dr.sum(values)[0])
