"""Lights carried around what the camera looks at, as on a turntable."""

import math
from dataclasses import replace

import numpy as np

from sixway.core.frames import Camera, Vector
from sixway.shading.light import DirectionalLight, Light, LineLight, PointLight, RectangleLight, SpotLight


def turned(light: Light, degrees: float, camera: Camera) -> Light:
    """The light carried around the camera's up axis through its target: from the front towards the right."""
    rotation = _about(np.array(camera.up), math.radians(degrees))

    def carried(point_m: Vector) -> Vector:
        return _vector(rotation @ (np.array(point_m) - camera.target_m) + camera.target_m)

    def swung(vector: Vector) -> Vector:
        return _vector(rotation @ np.array(vector))

    match light:
        case DirectionalLight():
            return light.turned(degrees)
        case PointLight():
            return replace(light, position_m=carried(light.position_m))
        case SpotLight():
            return replace(light, position_m=carried(light.position_m), towards=swung(light.towards))
        case LineLight():
            return replace(light, start_m=carried(light.start_m), end_m=carried(light.end_m))
        case RectangleLight():
            return replace(
                light,
                centre_m=carried(light.centre_m),
                half_right_m=swung(light.half_right_m),
                half_up_m=swung(light.half_up_m),
            )


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    """The right-handed rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross


def _vector(values: np.ndarray) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))
