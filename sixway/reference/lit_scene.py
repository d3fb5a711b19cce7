"""Lights and solids as Mitsuba describes them, at unit strength: colours are multiplied in afterwards."""

from collections.abc import Iterator, Sequence

import mitsuba as mi
import numpy as np

from sixway.core.frames import Camera
from sixway.core.solids import Box, Cylinder, Obstacle, Sphere
from sixway.reference.lights import (
    ConstantEnvironment,
    DirectionalLight,
    Light,
    PointLight,
    SpotLight,
    sun_disc,
)


def light_descriptions(light: Light, camera: Camera) -> dict[str, dict]:
    """Emitters of irradiance 1 (sun), intensity 1 (point, spot) or radiance 1 (environment) together.

    The disc of a sun is many suns, of which volpath asks one by chance at each vertex.
    """
    if not isinstance(light, DirectionalLight):
        return {"light": _description(light)}
    suns = sun_disc(light.to_light, light.angle_deg)
    return {
        f"light_{n}": {
            "type": "directional",
            "direction": (-np.array(camera.to_world(to_light))).tolist(),
            "irradiance": 1.0 / len(suns),
        }
        for n, to_light in enumerate(suns)
    }


def _description(light: PointLight | SpotLight | ConstantEnvironment) -> dict:
    match light:
        case PointLight():
            return {"type": "point", "position": list(light.position_m), "intensity": 1.0}
        case SpotLight():
            axis = np.array(light.towards)
            sideways = np.eye(3)[np.abs(axis).argmin()]  # any up that is not parallel: a spot has no roll
            pose = mi.ScalarTransform4f().look_at(
                origin=list(light.position_m), target=(light.position_m + axis).tolist(), up=sideways.tolist()
            )
            return {
                "type": "spot",
                "to_world": pose,
                "intensity": 1.0,
                "cutoff_angle": light.cutoff_deg,
                "beam_width": light.beam_deg,
            }
        case ConstantEnvironment():
            return {"type": "constant", "radiance": 1.0}


def obstacle_descriptions(obstacles: Sequence[Obstacle]) -> Iterator[dict]:
    """Black shapes; a cylinder takes three, because Mitsuba's is open."""
    transform = mi.ScalarTransform4f
    black = {"type": "diffuse", "reflectance": 0.0}
    for obstacle in obstacles:
        match obstacle:
            case Sphere():
                yield {"type": "sphere", "center": list(obstacle.centre_m), "radius": obstacle.radius_m, "bsdf": black}
            case Box():
                pose = transform().translate(list(obstacle.centre_m)) @ transform().scale(
                    [0.5 * edge for edge in obstacle.size_m]
                )
                yield {"type": "cube", "to_world": pose, "bsdf": black}
            case Cylinder():
                start, end = np.array(obstacle.start_m), np.array(obstacle.end_m)
                yield {
                    "type": "cylinder",
                    "p0": start.tolist(),
                    "p1": end.tolist(),
                    "radius": obstacle.radius_m,
                    "bsdf": black,
                }
                for face, outward in ((start, start - end), (end, end - start)):
                    sideways = np.eye(3)[np.abs(outward).argmin()]
                    pose = transform().look_at(
                        origin=face.tolist(), target=(face + outward).tolist(), up=sideways.tolist()
                    ) @ transform().scale(obstacle.radius_m)
                    yield {"type": "disk", "to_world": pose, "bsdf": black}
