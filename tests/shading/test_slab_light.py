"""Lamps in smoke: closed forms where there are any, the path tracer where there are none."""

import math

import numpy as np
import pytest

from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.frames import Camera, Grid, Vector
from sixway.core.records import DensityFrame, Medium, SixWayLightmap
from sixway.reference import lights as reference
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.reference.lit import trace_lit
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight, LineLight, PointLight, RectangleLight
from sixway.shading.slab import SmokeSlab
from sixway.shading.slab_light import map_in_smoke
from sixway.shading.surface import SmokeSurface

GRID = Grid.centred((32, 32, 32))
CAMERA = Camera.around(GRID, kind="orthographic", width_px=12, height_px=9)
SHAPE = (9, 12)
WHITE = (1.0, 1.0, 1.0)


def even_slab(depth: float, thickness_m: float = 0.5) -> SmokeSlab:
    """Even smoke about the middle of the view."""
    begins = np.full(SHAPE, CAMERA.distance_m - 0.5 * thickness_m)
    return SmokeSlab(
        camera=CAMERA,
        begins_m=begins,
        thickness_m=np.full(SHAPE, thickness_m),
        optical_depth=np.full(SHAPE, depth),
    )


def even_maps(value: float, alpha: float) -> SixWayLightmap:
    image = np.full((*SHAPE, 7), value, np.float32)
    image[..., 6] = alpha
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=image)


def lamp_at(x: float, y: float, z: float, intensity: float = 1.0) -> PointLight:
    """In the camera's frame, about the target."""
    x, y, z = (np.array(CAMERA.target_m) + np.array((x, y, z)) @ CAMERA.basis).tolist()
    return PointLight(position_m=(x, y, z), intensity=(intensity,) * 3, radius_m=0.001)


@pytest.mark.parametrize("rule", ["squared", "paper_abs", "abs_normalised", "smoothstep"])
@pytest.mark.parametrize("depth", [0.01, 1.0, 6.0])
@pytest.mark.parametrize("to_light", [(0.48, -0.6, 0.64), (0.0, 0.0, 1.0), (0.28, 0.0, -0.96)])
def test_a_lamp_far_away_is_a_sun(rule, depth: float, to_light: Vector, rng) -> None:
    image = rng.random((*SHAPE, 7), dtype=np.float32)
    lightmap = SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=image)
    far = 3e4
    lamp = lamp_at(*(far * part for part in to_light), intensity=math.pi * far**2)
    shown = shade(lightmap, [lamp], surface=even_slab(depth), rule=rule)
    sun = shade(lightmap, [DirectionalLight(to_light=to_light)], rule=rule)
    np.testing.assert_allclose(shown, sun, rtol=2e-4, atol=1e-4)


@pytest.mark.parametrize("z", [0.0, 0.2, -0.35])
def test_thin_smoke_scatters_once(z: float) -> None:
    """int sigma I / (4 pi r^2) dt over the slab, in closed form: nothing is lost on the way."""
    depth, thickness, near = 0.002, 0.5, 0.03
    u = (np.arange(12) + 0.5) / 12 * 2.0 - 1.0
    v = 1.0 - (np.arange(9) + 0.5) / 9 * 2.0
    across = np.hypot(u[None] * CAMERA.half_width_m - near, v[:, None] * CAMERA.half_height_m - near)
    angles = np.arctan((z + 0.5 * thickness) / across) - np.arctan((z - 0.5 * thickness) / across)
    expected = depth / thickness / (4.0 * math.pi) * angles / across
    shown = shade(even_maps(0.25 * depth, depth), [lamp_at(near, near, z)], surface=even_slab(depth))
    np.testing.assert_allclose(shown[..., 0], expected, rtol=0.02)


def test_smoke_takes_light_away_only_up_to_the_lamp() -> None:
    """Six black maps: what is left is what comes from the lamp itself, less with every mean free path."""
    depths = np.array([0.0, 0.5, 2.0])
    np.testing.assert_allclose(map_in_smoke(depths, np.zeros(3), 1.0), 0.25 * np.exp(-depths))
    np.testing.assert_allclose(map_in_smoke(np.array([9.0]), np.ones(1), 0.5), 0.125 * 1.5 * np.exp(-9.0), rtol=1e-6)
    slope = (map_in_smoke(np.array([1e-5]), np.ones(1), 1.0) / 0.25 - 1.0) / 1e-5
    assert slope == pytest.approx(1.0, abs=1e-3)  # - 1 lost, + 2 scattered twice
    dark = even_maps(0.0, 1.0)
    shown = [shade(dark, [lamp_at(0.0, 0.0, z)], surface=even_slab(6.0))[4, 6, 0] for z in (0.2, 0.0, -0.2)]
    assert shown[0] > 3.0 * shown[1] > 9.0 * shown[2] > 0.0


def test_nothing_jumps_where_a_lamp_enters_the_smoke() -> None:
    places = np.linspace(0.45, 0.05, 81)  # the slab begins at 0.25
    slab, maps = even_slab(4.0), even_maps(0.2, 1.0 - math.exp(-4.0))
    shown = np.array([shade(maps, [lamp_at(0.02, 0.03, float(z))], surface=slab)[..., 0] for z in places])
    steps = np.abs(np.diff(np.log(shown), axis=0))
    assert steps.max() < 0.12 and steps.max() < 3.0 * np.median(steps.max(axis=(1, 2)))


def test_nothing_jumps_where_a_lamp_leaves_the_picture() -> None:
    """The smoke is five times as thick on the right, where the lamp goes out; in black maps nothing else counts."""
    depth = np.where(np.arange(12) < 6, 1.0, 5.0) * np.ones(SHAPE)
    even = even_slab(1.0)
    slab = SmokeSlab(camera=CAMERA, begins_m=even.begins_m, thickness_m=even.thickness_m, optical_depth=depth)
    maps, edge = even_maps(0.0, 0.9), CAMERA.half_width_m
    places = np.linspace(0.85 * edge, 1.15 * edge, 61)
    shown = np.array([shade(maps, [lamp_at(float(x), 0.0, 0.0)], surface=slab)[..., 0] for x in places])
    assert np.abs(np.diff(np.log(shown[:, :, :9]), axis=0)).max() < 0.2  # the last columns see the lamp go by


def test_a_short_wire_is_a_lamp_and_a_panel_shines_on_one_side() -> None:
    slab, maps = even_slab(2.0), even_maps(0.15, 1.0 - math.exp(-2.0))
    lamp = lamp_at(0.04, 0.05, 0.0)
    x, y, z = lamp.position_m
    wire = LineLight(start_m=(x - 1e-3, y, z), end_m=(x + 1e-3, y, z), intensity=WHITE, radius_m=0.001)
    as_lamp = shade(maps, [lamp], surface=slab)
    np.testing.assert_allclose(shade(maps, [wire], surface=slab), as_lamp, rtol=0.02)

    def panel(up: float) -> np.ndarray:
        light = RectangleLight(
            centre_m=lamp.position_m, half_right_m=(0.01, 0.0, 0.0), half_up_m=(0.0, up, 0.0), radiance=WHITE
        )
        return shade(maps, [light], surface=slab)[..., 0]

    front, back = panel(0.01), panel(-0.01)  # right x up points to the viewer, and away
    assert (front > 2.0 * back).all()  # its light reaches the camera through less smoke
    assert (back > 0.0).all()
    assert (front + back < as_lamp[..., 0] * 4.0 * 0.01**2 * 1.2).all()  # solid angles are at most area / r^2


def test_colours_and_lamps_behind_the_camera() -> None:
    slab, maps = even_slab(2.0), even_maps(0.15, 1.0 - math.exp(-2.0))
    camera = Camera.around(GRID, width_px=12, height_px=9)
    behind = np.array(camera.position_m) + np.array(camera.to_viewer)
    x, y, z = behind.tolist()
    pinhole = SmokeSlab(
        camera=camera,
        begins_m=np.full(SHAPE, camera.distance_m),
        thickness_m=slab.thickness_m,
        optical_depth=slab.optical_depth,
    )
    shown = shade(maps, [PointLight(position_m=(x, y, z), intensity=(0.0, 2.0, 4.0))], surface=pinhole)
    assert not shown[..., 0].any() and (shown[..., 1] > 0.0).all()
    np.testing.assert_allclose(shown[..., 2], 2.0 * shown[..., 1], rtol=1e-5)
    with pytest.raises(ValueError, match="slab of"):
        shade(SixWayLightmap(channels=maps.channels, image=maps.image[1:]), [lamp_at(0, 0, 0)], surface=slab)


@pytest.mark.parametrize("z", [0.0, 0.3])
def test_a_lamp_in_a_ball_of_smoke_against_the_path_tracer(z: float) -> None:
    """Optical depth 5 from side to side. With one direction a pixel it comes out at 0.13 to 0.15 of the truth."""
    offset = np.indices(GRID.shape_zyx) - 15.5
    radius = np.sqrt((offset**2).sum(axis=0)) / 32.0
    frame = DensityFrame(density=np.clip((0.42 - radius) * 32.0, 0.0, 1.0).astype(np.float32), grid=GRID)
    medium = Medium(extinction_per_m=6.0)
    camera = Camera.around(GRID, width_px=24, height_px=24, margin=0.7)
    maps = LightmapTracer(ReferenceConfig(), medium, device="cpu").trace(frame, camera, seed=0)
    x, y, z = (z * np.array(camera.to_viewer)).tolist()
    traced = reference.PointLight(position_m=(x, y, z), intensity=WHITE)
    truth = trace_lit(frame, camera, medium, [traced], samples=128, device="cpu")[..., 0]
    lamp = PointLight(position_m=(x, y, z), intensity=WHITE)
    shown = shade(maps, [lamp], surface=SmokeSlab.from_frame(frame, medium, camera))[..., 0]
    old = shade(maps, [lamp], surface=SmokeSurface.from_depth(camera, np.full((24, 24), camera.distance_m - 0.4)))
    assert old.max(axis=-1).sum() < 0.3 * truth.sum()
    assert shown.sum() == pytest.approx(truth.sum(), rel=0.25)
    ball = truth > 0.05 * np.quantile(truth, 0.99)
    off = np.abs(np.log(shown[ball] / truth[ball]))
    assert np.median(off) < math.log(1.4)
