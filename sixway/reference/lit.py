"""The door to the truth of lit pictures: smoke, lights of any kind and solids in, one linear RGB image out.

image = trace_lit(frame, Camera.around(frame.grid), medium, [DirectionalLight(to_light=(1.0, 0.0, 0.0))])
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sixway.core.conventions import Bounces
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.core.solids import Obstacle
from sixway.reference.lights import ConstantEnvironment, DirectionalLight, Light, PointLight, SpotLight
from sixway.reference.variant import Device, use_variant


def trace_lit(
    frame: DensityFrame,
    camera: Camera,
    medium: Medium,
    lights: Sequence[Light],
    *,
    obstacles: Sequence[Obstacle] = (),
    bounces: Bounces = "paper",
    samples: int = 256,
    seed: int = 0,
    device: Device = "auto",
) -> Float[np.ndarray, "h w 3"]:
    """Radiance of the smoke on black (so alpha-premultiplied), linear RGB float32, by Mitsuba's volpath.

    A sun of colour c alone shows c times a six-way map. Obstacles are black: they shadow the smoke and hide
    what is behind them. Fire is not part of it; lights are not seen themselves. samples: paths per pixel and
    light, noise falls with 1 / sqrt(samples). Raises ValueError for fewer than one sample, for a camera
    inside the volume, and for a frame that has solids where `obstacles` names none.
    """
    if samples < 1:
        raise ValueError(f"{samples} samples must be at least 1")
    if not obstacles and frame.obstacle is not None and (frame.obstacle > 0.5).any():
        raise ValueError("the frame has solid voxels, which cast no shadow here; describe them in `obstacles`")
    use_variant(device)
    # imported here: these load Dr.Jit, which must not happen before use_variant has chosen its LLVM
    import mitsuba as mi

    from sixway.reference.lit_scene import light_descriptions, obstacle_descriptions
    from sixway.reference.media import padded
    from sixway.reference.scene import sensor, smoke_box
    from sixway.reference.stock import check_outside, render, volpath

    extinction = padded(frame, medium)
    check_outside(extinction, camera)
    still = {
        "type": "scene",
        "sensor": sensor(camera),
        **{f"obstacle_{n}": shape for n, shape in enumerate(obstacle_descriptions(obstacles))},
    }
    integrator = volpath(bounces)
    image = np.zeros((camera.height_px, camera.width_px, 3))
    # one render per light: volpath would ask one of them, by chance, at each vertex; colours do not mix
    for number, light in enumerate(lights):
        emitters = light_descriptions(light, camera)
        pictures = {}
        for grey in dict.fromkeys(medium.by_colour):
            box = smoke_box(extinction.sigma_t, extinction.grid, grey)
            scene = mi.load_dict(still | {"box": box} | emitters)
            pictures[grey] = render(scene, integrator, camera, samples=samples, seeds=(seed, number))
        shown = np.stack([pictures[grey] for grey in medium.by_colour], axis=-1)
        image += shown * np.array(_strength(light))
    return image.astype(np.float32)


def _strength(light: Light) -> tuple[float, float, float]:
    """RGB that multiplies the picture of the light in the units of `light_description`."""
    match light:
        case DirectionalLight(colour=(red, green, blue)):
            return np.pi * red, np.pi * green, np.pi * blue
        case PointLight(intensity=intensity) | SpotLight(intensity=intensity):
            return intensity
        case ConstantEnvironment(radiance=radiance):
            return radiance
