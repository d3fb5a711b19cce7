"""A frame of smoke as a Mitsuba scene: an empty-skinned box of medium, one sun, one sensor."""

import math

import mitsuba as mi
import numpy as np
from jaxtyping import Float

from sixway.core.conventions import TO_LIGHT
from sixway.core.frames import Camera, Grid
from sixway.core.records import Medium
from sixway.reference.lights import sun_disc
from sixway.reference.media import Extinction

_FIELD = "box.interior_medium.sigma_t.data"


class SmokeScene:
    """A scene for one grid, image size and kind of camera; new frames, poses and lights update it in place.

    Updating keeps the compiled kernels, which a scene loaded afresh does not. The light has irradiance 1; one
    that is `light_angle_deg` wide is many suns, of which volpath asks one by chance at each vertex.
    """

    def __init__(self, grid: Grid, camera: Camera, medium: Medium, *, light_angle_deg: float = 0.0) -> None:
        self.key = scene_key(grid, camera)
        self._angle_deg = light_angle_deg
        suns = len(sun_disc((0.0, 0.0, 1.0), light_angle_deg))
        empty = np.zeros(grid.shape_zyx, np.float32)
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "sensor": sensor(camera),
                **{f"light_{n}": {"type": "directional", "irradiance": 1.0 / suns} for n in range(suns)},
                "box": smoke_box(empty, grid, medium),
            }
        )
        self._parameters = mi.traverse(self.scene)

    def show(self, extinction: Extinction, camera: Camera) -> None:
        """Fill the grid [1/m] and stand the sensor where `camera` is; both must fit the scene's key."""
        assert scene_key(extinction.grid, camera) == self.key
        self._parameters[_FIELD] = mi.TensorXf(extinction.sigma_t[..., None])
        self._parameters["sensor.to_world"] = mi.Transform4f(_pose(camera))
        if camera.kind == "perspective":
            self._parameters["sensor.x_fov"] = mi.Float(_x_fov_deg(camera))
        self._parameters.update()

    def light_from(self, direction: str, camera: Camera) -> None:
        """Turn the sun so that its light comes from that direction of the camera's frame."""
        # any up that is not parallel: a sun has no roll
        up = camera.basis[0] if direction in ("top", "bottom") else camera.basis[1]
        for n, to_light in enumerate(sun_disc(TO_LIGHT[direction], self._angle_deg)):
            travels = -np.array(camera.to_world(to_light))
            pose = mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=list(travels), up=list(up))
            self._parameters[f"light_{n}.to_world"] = mi.Transform4f(pose)
        self._parameters.update()


def scene_key(grid: Grid, camera: Camera) -> tuple[Grid, str, int, int]:
    """What a scene cannot change once it is loaded."""
    return grid, camera.kind, camera.width_px, camera.height_px


def smoke_box(sigma_t: Float[np.ndarray, "z y x"], grid: Grid, medium: Medium) -> dict:
    """A box without a surface, full of smoke of that extinction [1/m]."""
    transform = mi.ScalarTransform4f
    centre, half = list(grid.centre_m), [0.5 * edge for edge in grid.extent_m]
    return {
        "type": "cube",
        "to_world": transform().translate(centre) @ transform().scale(half),
        "bsdf": {"type": "null"},
        "interior": {
            "type": "heterogeneous",
            "sigma_t": {
                "type": "gridvolume",
                "grid": mi.VolumeGrid(sigma_t[..., None]),
                "to_world": transform().translate(list(grid.origin_m)) @ transform().scale(list(grid.extent_m)),
                "filter_type": "trilinear",
                "wrap_mode": "clamp",
                "raw": True,
            },
            "albedo": {"type": "constvolume", "value": medium.grey_albedo},
            "phase": {"type": "hg", "g": medium.hg_g},
        },
    }


def sensor(camera: Camera) -> dict:
    """The camera as Mitsuba's sensor of one luminance channel."""
    description = {
        "type": camera.kind if camera.kind == "orthographic" else "perspective",
        "to_world": _pose(camera),
        "near_clip": 1e-3 * camera.distance_m,
        "far_clip": 1e3 * camera.distance_m,
        "film": {
            "type": "hdrfilm",
            "width": camera.width_px,
            "height": camera.height_px,
            "pixel_format": "luminance",
            "component_format": "float32",
            "rfilter": {"type": "box"},  # a wider filter would mix pixels
        },
        "sampler": {"type": "independent"},
    }
    if camera.kind == "perspective":
        description |= {"fov": _x_fov_deg(camera), "fov_axis": "x"}
    return description


def _pose(camera: Camera) -> "mi.ScalarTransform4f":
    """Sensor to world. Mitsuba's sensors look along their +z with +x to the image's LEFT: look_at knows."""
    pose = mi.ScalarTransform4f().look_at(
        origin=list(camera.position_m), target=list(camera.target_m), up=list(camera.up)
    )
    if camera.kind == "orthographic":  # its image is 2 wide before scaling, whatever its aspect
        pose = pose @ mi.ScalarTransform4f().scale([camera.half_width_m, camera.half_width_m, 1.0])
    return pose


def _x_fov_deg(camera: Camera) -> float:
    return math.degrees(2.0 * math.atan(camera.half_width_m / camera.distance_m))
