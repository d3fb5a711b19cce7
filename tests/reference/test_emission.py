"""Fire behind its own smoke: closed forms, the same from every method, hidden by solids."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera
from sixway.core.records import DensityFrame, Medium
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig

CAMERA = Camera.orthographic(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), width_px=16, height_px=16)


def emissive(frame: DensityFrame, extinction_per_m: float, device: str, method: str = "cached") -> np.ndarray:
    tracer = LightmapTracer(
        ReferenceConfig(method=method, bounces="single", samples=1),
        Medium(extinction_per_m=extinction_per_m),
        device=device,
    )
    maps = tracer.trace(frame, CAMERA, seed=0)
    assert maps.channels == LIGHTMAP_CHANNELS
    return maps["emissive"]


@pytest.mark.parametrize("method", ["cached", "path", "stock"])
@pytest.mark.parametrize("optical_depth", [0.0, 1e-4, 4.0])
def test_a_uniform_cube_glows_as_kirchhoff_says(
    cube_frame: DensityFrame, device: str, method: str, optical_depth: float
) -> None:
    """L = Le (1 - exp(-s)) with Le = emission / sigma_t; emission times length where nothing absorbs."""
    frame = replace(cube_frame, emission=np.full_like(cube_frame.density, 2.0))
    s = optical_depth
    expected = 2.0 / s * -math.expm1(-s) if s else 2.0
    np.testing.assert_allclose(emissive(frame, s, device, method)[2:-2, 2:-2], expected, rtol=2e-3)


def test_smoke_in_front_dims_a_flame_and_smoke_behind_does_not(cube_frame: DensityFrame, device: str) -> None:
    flame = np.zeros_like(cube_frame.density)
    near, far = flame.copy(), flame.copy()
    near[-2:], far[:2] = 1.0, 1.0  # the viewer stands at +z
    bright, dim = (emissive(replace(cube_frame, emission=e), 3.0, device)[8, 8] for e in (near, far))
    assert dim / bright == pytest.approx(math.exp(-3.0 * 30 / 32), rel=0.02)


def test_a_solid_hides_the_fire_behind_it(cube_frame: DensityFrame, device: str) -> None:
    wall = np.zeros_like(cube_frame.density)
    wall[-1, :, 16:] = 1.0
    frame = replace(cube_frame, emission=np.ones_like(wall), obstacle=wall)
    image = emissive(frame, 1.0, device)
    assert image[:, :7].min() > 0.3
    assert image[1:-1, 9:-1].max() < 0.05  # at the border, half a voxel of wall is less than solid


def test_a_cold_frame_that_could_burn_is_black(cube_frame: DensityFrame, device: str) -> None:
    assert not emissive(replace(cube_frame, emission=np.zeros_like(cube_frame.density)), 1.0, device).any()
