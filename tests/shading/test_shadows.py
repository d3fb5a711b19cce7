"""Shadows where geometry says they are, and their shares where closed forms say how much."""

import math

import numpy as np
import pytest

from sixway.core.frames import Camera, Grid
from sixway.core.records import DensityFrame, Medium
from sixway.core.solids import Box, Cylinder, Mesh, Solid, Sphere
from sixway.shading.light import DirectionalLight, PointLight, RectangleLight, SpotLight
from sixway.shading.shadow_map import shadow_map, visibility
from sixway.shading.shadow_volume import LightDepth, march_rays, shadowed_share
from sixway.shading.solid_depth import bounding_sphere, solid_depth
from sixway.shading.surface import SmokeSurface

GRID = Grid.centred((16, 16, 16))  # a cube of 1 m
FRONT = Camera.orthographic(position_m=(0.0, 0.0, 3.0), target_m=(0.0, 0.0, 0.0), size_m=1.0, width_px=32, height_px=32)
BOX_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def box_mesh(centre_m: tuple[float, float, float], size_m: tuple[float, float, float]) -> Mesh:
    return Mesh(corners_m=np.array(centre_m) + BOX_CORNERS * np.array(size_m), faces=BOX_FACES)


def closed_form_depths() -> list[tuple[Solid, float, float]]:
    """Solid, depth of the ray through the middle from z = 3, half width of the solid in the picture."""
    return [
        (Sphere(centre_m=(0.0, 0.0, 0.2), radius_m=0.3), 2.5, 0.3),
        (Box(centre_m=(0.0, 0.0, 0.1), size_m=(0.4, 0.4, 0.6)), 2.6, 0.2),
        (Cylinder(start_m=(0.0, 0.0, -0.4), end_m=(0.0, 0.0, 0.4), radius_m=0.25), 2.6, 0.25),
        (Cylinder(start_m=(-0.9, 0.0, 0.0), end_m=(0.9, 0.0, 0.0), radius_m=0.25), 2.75, 0.5),
        (box_mesh((0.0, 0.0, 0.1), (0.4, 0.4, 0.6)), 2.6, 0.2),
    ]


@pytest.mark.parametrize(("solid", "middle_m", "half_width_m"), closed_form_depths())
def test_depths_of_solids(solid: Solid, middle_m: float, half_width_m: float) -> None:
    depth = solid_depth([solid], FRONT)
    assert depth[15:17, 15:17] == pytest.approx(middle_m, abs=2e-3)
    x = (np.arange(32) + 0.5) / 32 - 0.5
    np.testing.assert_array_equal(np.isfinite(depth[16]), np.abs(x) < half_width_m)


@pytest.mark.parametrize("solid", [case[0] for case in closed_form_depths()])
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_what_a_ray_meets_lies_on_the_solid(solid: Solid, kind) -> None:
    """Its distance to the solid's surface is 0, and from the middle of the solid outwards nothing is missed."""
    camera = Camera.around(GRID, yaw_deg=30.0, pitch_deg=25.0, kind=kind, width_px=24, height_px=24)
    origins, towards = camera.rays()
    depth = solid_depth([solid], camera)
    hit = np.isfinite(depth)
    assert hit.any() and not hit.all()
    points = (origins + np.where(hit, depth, 0.0)[..., None] * towards)[hit]
    centre, radius = bounding_sphere(solid)
    assert (np.linalg.norm(points - centre, axis=-1) <= radius + 1e-9).all()
    match solid:
        case Sphere():
            gap = np.linalg.norm(points - centre, axis=-1) - solid.radius_m
        case Cylinder():
            axis = np.array(solid.end_m) - solid.start_m
            half = 0.5 * np.linalg.norm(axis)
            along = (points - centre) @ (axis / (2 * half))
            aside = np.linalg.norm(points - centre - along[:, None] * axis / (2 * half), axis=-1)
            gap = np.maximum(np.abs(along) - half, aside - solid.radius_m)
        case _:
            gap = (np.abs(points - np.array([0.0, 0.0, 0.1])) - np.array([0.2, 0.2, 0.3])).max(axis=-1)
    np.testing.assert_allclose(gap, 0.0, atol=1e-6)


def test_the_nearest_solid_counts_and_those_behind_the_camera_do_not() -> None:
    near, far = Sphere(centre_m=(0.0, 0.0, 1.0), radius_m=0.1), Sphere(centre_m=(0.0, 0.0, 0.0), radius_m=0.4)
    behind = Sphere(centre_m=(0.0, 0.0, 5.0), radius_m=0.5)
    depth = solid_depth([far, behind, near], FRONT)
    assert depth[16, 16] == pytest.approx(1.9, abs=0.02)
    assert depth[16, 22] == pytest.approx(3.0 - math.sqrt(0.16 - (6.5 / 32) ** 2 - (0.5 / 32) ** 2), abs=1e-6)
    assert np.isinf(solid_depth([behind], FRONT)).all()


@pytest.mark.parametrize("as_mesh", [False, True])
def test_a_box_shadows_a_rectangle_of_the_shell(as_mesh: bool) -> None:
    """Sun from the upper right at 45 degrees; box of 0.2 m, 0.5 m to the right and above: its shadow is where the
    shell's points, moved along the light, enter it."""
    size = (0.2, 0.2, 0.2)
    box = box_mesh((0.5, 0.5, 0.0), size) if as_mesh else Box(centre_m=(0.5, 0.5, 0.0), size_m=size)
    sun = DirectionalLight(to_light=(math.sqrt(0.5), math.sqrt(0.5), 0.0))
    surface = SmokeSurface.from_depth(FRONT, np.full((32, 32), 3.05))  # the plane z = -0.05
    lit = visibility(shadow_map(sun, [box], GRID, FRONT, size_px=512), surface)
    x, y = surface.points_m[..., 0], surface.points_m[..., 1]
    across, along = (x - y) / math.sqrt(2.0), (x + y) / math.sqrt(2.0)
    clear_dark = (np.abs(across) < 0.13) & (along < 0.5)
    clear_lit = np.abs(across) > 0.15
    assert not lit[clear_dark].any() and (lit[clear_lit] == 1.0).all()
    in_front = SmokeSurface.from_depth(FRONT, np.full((32, 32), 2.85))  # the plane z = 0.15, beside the box
    assert (visibility(shadow_map(sun, [box], GRID, FRONT), in_front) == 1.0).all()


def test_a_wide_sun_has_half_shadows_as_wide_as_geometry_says() -> None:
    """A wall's edge 1 m before the shell, a sun 10 degrees wide: the shadow's edge is 2 tan(5 deg) m wide."""
    wall = Box(centre_m=(0.0, -5.0, 1.0), size_m=(12.0, 10.0, 0.02))
    surface = SmokeSurface.from_depth(FRONT, np.full((32, 32), 3.0))
    shadow = shadow_map(DirectionalLight(to_light=(0.0, 0.0, 1.0), angle_deg=10.0), [wall], GRID, FRONT, size_px=512)
    lit = visibility(shadow, surface)[:, 16]
    y = surface.points_m[:, 16, 1]
    half = math.tan(math.radians(5.0))
    assert (lit[y > half + 0.04] == 1.0).all() and (lit[y < -half - 0.04] == 0.0).all()
    assert lit[np.abs(y) < 0.02] == pytest.approx(0.5, abs=0.15)
    assert (np.diff(lit) <= 1e-9).all()  # from the top down it only darkens


@pytest.mark.parametrize("kind", ["point", "spot", "panel"])
def test_lamps_cast_shadows_that_grow(kind: str) -> None:
    """A ball half way between the lamp and the shell: its shadow is twice its size."""
    at = (0.0, 0.0, 2.0)
    light = {
        "point": PointLight(position_m=at, intensity=(1.0, 1.0, 1.0)),
        "spot": SpotLight(position_m=at, towards=(0.0, 0.0, -1.0), intensity=(1.0, 1.0, 1.0)),
        "panel": RectangleLight(
            centre_m=at, half_right_m=(-0.1, 0.0, 0.0), half_up_m=(0.0, 0.1, 0.0), radiance=(1.0, 1.0, 1.0)
        ),
    }[kind]
    ball = Sphere(centre_m=(0.0, 0.0, 1.0), radius_m=0.15)
    surface = SmokeSurface.from_depth(FRONT, np.full((32, 32), 3.0))
    lit = visibility(shadow_map(light, [ball], GRID, FRONT), surface)
    radius = np.linalg.norm(surface.points_m[..., :2], axis=-1)
    slack = 0.03 + (0.1 if kind == "panel" else 0.0)
    assert not lit[radius < 0.30 - slack].any() and (lit[radius > 0.305 + slack] == 1.0).all()


def test_lamps_too_near_are_refused() -> None:
    lamp = PointLight(position_m=(0.0, 0.0, 0.0), intensity=(1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match="up to 120: move the lamp away"):
        shadow_map(lamp, [], GRID, FRONT)


@pytest.fixture
def cube() -> tuple[DensityFrame, Medium]:
    """A homogeneous cube of optical depth 3."""
    return DensityFrame(density=np.ones((16, 16, 16), np.float32), grid=GRID), Medium(extinction_per_m=3.0)


def test_the_march_is_single_scattering(cube) -> None:
    """Lit from the camera, a slab of optical depth s shows M = (1 - exp(-2 s)) / 8."""
    frame, medium = cube
    sigma_t = frame.density * np.float32(medium.extinction_per_m)
    to_light = LightDepth(DirectionalLight.parse("front"), sigma_t, GRID, FRONT, cells=64)
    inner = march_rays(sigma_t, GRID, FRONT, to_light, steps=64).once[8:-8, 8:-8].sum(axis=-1)
    np.testing.assert_allclose(inner, (1.0 - math.exp(-6.0)) / 8.0, rtol=0.03)


def test_half_a_ray_in_shadow_keeps_what_its_lit_half_scatters(cube) -> None:
    """Sun from the left; a wall that stands there shadows all behind z = 0: the front half of each ray is lit.

    With light from the side every point of a ray gets alike much of it, so the share is the light of the first
    optical depth s / 2 in that of s: (1 - exp(-s / 2)) / (1 - exp(-s)).
    """
    frame, medium = cube
    wall = Box(centre_m=(-1.5, 0.0, -2.5), size_m=(0.1, 10.0, 5.0))
    left = shadowed_share(DirectionalLight.parse("left"), [wall], frame, medium, FRONT, steps=64)
    expected = (1.0 - math.exp(-1.5)) / (1.0 - math.exp(-3.0))
    np.testing.assert_allclose(left[6:-6, 6:-6], expected, atol=0.03)
    right = shadowed_share(DirectionalLight.parse("right"), [wall], frame, medium, FRONT, steps=16)
    np.testing.assert_allclose(right, 1.0, atol=1e-9)  # light from the other side is not shadowed


def test_with_nothing_in_the_way_all_is_lit(cube) -> None:
    for arrived in (None, np.full((32, 32), 0.5)):
        share = shadowed_share(DirectionalLight.parse("top"), [], *cube, FRONT, arrived=arrived, steps=8, cells=16)
        np.testing.assert_allclose(share, 1.0)


def test_light_that_scattered_twice_fills_the_shadow(cube) -> None:
    """A wall shadows the right half: its dark side brightens towards the edge, the lit side loses a little there."""
    wall = Box(centre_m=(2.5, 0.0, 2.0), size_m=(5.0, 10.0, 0.1))
    front = DirectionalLight.parse("front")
    once = shadowed_share(front, [wall], *cube, FRONT, steps=16, cells=16)[16]
    both = shadowed_share(front, [wall], *cube, FRONT, arrived=np.full((32, 32), 0.4), steps=16, cells=16)[16]
    np.testing.assert_allclose(once[:15], 1.0)
    np.testing.assert_allclose(once[17:], 0.0)
    assert both[17] > 0.1 and both[14] < 0.95
    assert (np.diff(both) < 1e-9).all()  # darker from left to right


def test_impossible_meshes_are_refused() -> None:
    with pytest.raises(ValueError, match="must name corners 0 to 7"):
        Mesh(corners_m=BOX_CORNERS, faces=np.array([[0, 1, 8]]))
    with pytest.raises(ValueError, match="finite"):
        Mesh(corners_m=BOX_CORNERS * np.nan, faces=BOX_FACES)
