"""The GLSL twin in a real OpenGL ES 3 against NumPy: all rules, all lights, colours, skies, shadows, compositing."""

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS, TO_LIGHT
from sixway.core.frames import Camera, Grid
from sixway.core.records import SixWayLightmap
from sixway.core.solids import Sphere
from sixway.shading.ambient import Ambient
from sixway.shading.colour import SmokeColour, coloured
from sixway.shading.compose import shade
from sixway.shading.light import DirectionalLight, LineLight, NearLight, PointLight, RectangleLight, SpotLight
from sixway.shading.near import middle_of
from sixway.shading.remap import Contrast, Remap, remap_values
from sixway.shading.scene import composed
from sixway.shading.shader import CHAPTERS, glsl
from sixway.shading.shadow_map import shadow_map, visibility
from sixway.shading.slab import SmokeSlab
from sixway.shading.surface import SmokeSurface, project

SIZE = (24, 32)
RULES = ("squared", "paper_abs", "abs_normalised", "smoothstep")
CAMERA = Camera.around(Grid.centred((8, 8, 8)), yaw_deg=30.0, pitch_deg=20.0, width_px=SIZE[1], height_px=SIZE[0])
WITHIN = 2.0 / 255.0
_HEAD = "\nout vec4 colour;\nvoid main() {\n  ivec2 at = ivec2(gl_FragCoord.xy);\n"
_MAPS = "  vec4 plus = texelFetch(positive, at, 0);\n  vec3 minus = texelFetch(negative, at, 0).rgb;\n"
_SAMPLERS = "uniform sampler2D positive, negative, surface, depths;\n"


def vec(values) -> str:
    return f"vec{len(values)}({', '.join(f'{float(value):.9g}' for value in values)})"


def number(value: float) -> str:
    return f"float({value:.9g})"


@pytest.fixture(scope="module")
def maps() -> SixWayLightmap:
    rng = np.random.default_rng(5)
    image = rng.random((*SIZE, 7)).astype(np.float32)
    image[..., :6] *= image[..., 6:]
    image[0, 0] = 0.0
    return SixWayLightmap(channels=LIGHTMAP_CHANNELS[:-1], image=image)


@pytest.fixture(scope="module")
def surface() -> SmokeSurface:
    rng = np.random.default_rng(6)
    return SmokeSurface.from_depth(CAMERA, 3.15 + 0.4 * rng.random(SIZE))


MEAN_M = 3.35 + 0.3 * np.random.default_rng(7).random(SIZE)
SPREAD_M = 0.02 + 0.3 * np.random.default_rng(8).random(SIZE)


@pytest.fixture(scope="module")
def slab(maps: SixWayLightmap) -> SmokeSlab:
    return SmokeSlab.from_moments(CAMERA, maps["alpha"], MEAN_M, SPREAD_M, albedo=0.8)


LAMPS: dict[str, NearLight] = {
    "point": PointLight(position_m=(0.1, 0.2, 0.05), intensity=(0.3, 0.2, 0.1), range_m=0.9, radius_m=0.05),
    "spot": SpotLight(
        position_m=(1.0, 0.5, 0.2), towards=(-0.8, -0.6, 0.0), intensity=(2.0, 1.0, 3.0), cutoff_deg=25.0, beam_deg=5.0
    ),
    "line": LineLight(start_m=(-0.5, 0.7, 0.2), end_m=(0.6, 0.6, 0.5), intensity=(0.5, 0.7, 1.0), radius_m=0.02),
    "rectangle": RectangleLight(
        centre_m=(0.2, 1.1, 0.1),
        half_right_m=(0.5, 0.0, 0.0),
        half_up_m=(0.0, 0.0, 0.3),
        radiance=(2.0, 3.0, 1.0),
        range_m=4.0,
    ),
}


def call_of(light: NearLight) -> tuple[str, tuple[float, float, float]]:
    """The shader's call for a lamp, and its colour."""
    match light:
        case PointLight(position_m=at, intensity=colour):
            end = light.range_m if math.isfinite(light.range_m) else 0.0
            return f"from_point(p, {vec(at)}, {number(light.radius_m)}, {number(end)}, to_light, strength)", colour
        case SpotLight(position_m=at, towards=axis, intensity=colour):
            angles = ", ".join(number(math.radians(angle)) for angle in (light.cutoff_deg, light.beam_deg))
            radius = number(light.radius_m)
            return f"from_spot(p, {vec(at)}, {vec(axis)}, {angles}, {radius}, 0.0, to_light, strength)", colour
        case LineLight(start_m=start, end_m=end_m, intensity=colour):
            radius = number(light.radius_m)
            return f"from_line(p, {vec(start)}, {vec(end_m)}, {radius}, 0.0, to_light, strength)", colour
        case RectangleLight(centre_m=at, half_right_m=right, half_up_m=up, radiance=colour):
            end = number(light.range_m)
            return f"from_rectangle(p, {vec(at)}, {vec(right)}, {vec(up)}, {end}, to_light, strength)", colour
    raise AssertionError(light)


def lamp_shader(light: NearLight) -> str:
    call, colour = call_of(light)
    to_camera = ", ".join(vec(column) for column in CAMERA.basis.T)
    return (
        glsl("blend", "near", "colour")
        + _SAMPLERS
        + _HEAD
        + _MAPS
        + f"""
  vec3 p = texelFetch(surface, at, 0).xyz, to_light;
  float strength;
  {call};
  float lit = blended(plus.rgb, minus, mat3({to_camera}) * to_light, SQUARED);
  colour = vec4(multiplied(lit * strength / PI, {vec(colour)}), plus.a);
}}"""
    )


def slab_shader(light: NearLight, mean: float) -> str:
    """A lamp in slabs whose moments are in the texture depths; rays are in the texture surface.

    mean: extinction of the picture.
    """
    call, colour = call_of(light)
    to_camera = ", ".join(vec(column) for column in CAMERA.basis.T)
    u, v = project(CAMERA, middle_of(light)[None])[0][0]
    corner = f"ivec2({math.floor(u - 0.5)}, {math.floor(v - 0.5)})"
    part = vec(((u - 0.5) % 1.0, (v - 0.5) % 1.0))
    return (
        glsl("blend", "near", "slab", "colour")
        + _SAMPLERS
        + """
Slab slab_at(ivec2 at, out float alpha) {
  alpha = texelFetch(positive, at, 0).a;
  vec2 moments = texelFetch(depths, at, 0).xy;
  return slab_from(alpha, moments.x, moments.y);
}
vec2 lamp_at(ivec2 at) {
  ivec2 size = textureSize(positive, 0);
  if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, size))) return vec2(0.0);
  float alpha;
  Slab slab = slab_at(at, alpha);
  return alpha * vec2(1.0, slab.optical_depth / slab.thickness_m);
}
"""
        + _HEAD
        + _MAPS
        + f"""
  ivec2 corner = {corner};
  vec2 part = {part};
  vec2 above = mix(lamp_at(corner), lamp_at(corner + ivec2(1, 0)), part.x);
  vec2 below = mix(lamp_at(corner + ivec2(0, 1)), lamp_at(corner + ivec2(1, 1)), part.x);
  float alpha, at_m, strength, lit = 0.0;
  Slab slab = slab_at(at, alpha);
  float at_lamp = extinction_at_lamp(mix(above, below, part.y), {number(mean)});
  float extinction = extinction_to(slab, alpha, at_lamp);
  vec3 towards = texelFetch(surface, at, 0).xyz, origin = {vec(CAMERA.position_m)}, shares, to_light;
  vec3 focus = {focus_of(light, "origin + (slab.begins_m + 0.5 * slab.thickness_m) * towards")};
  for (int n = 0; n < SLAB_STEPS; ++n) {{
    slab_step(slab, origin, towards, focus, n, at_m, shares);
    vec3 p = origin + at_m * towards;
    {call};
    float depth = extinction * distance(p, {focus_of(light, "p")});
    lit += strength * slab_light(plus.rgb, minus, alpha, shares, mat3({to_camera}) * to_light, SQUARED, depth, 0.8);
  }}
  colour = vec4(multiplied(lit / PI, {vec(colour)}), alpha);
}}"""
    )


def focus_of(light: NearLight, point: str) -> str:
    """The shader's expression for the part of the light that is nearest to a point."""
    match light:
        case LineLight(start_m=start, end_m=end):
            return f"nearest_on_line({point}, {vec(start)}, {vec(end)})"
        case RectangleLight(centre_m=at, half_right_m=right, half_up_m=up):
            return f"nearest_on_rectangle({point}, {vec(at)}, {vec(right)}, {vec(up)})"
        case _:
            return vec(light.position_m)


def sun_shader(to_light, rule: str) -> str:
    body = f"  colour = vec4(vec3(blended(plus.rgb, minus, {vec(to_light)}, {rule.upper()})), plus.a);\n}}"
    return glsl("blend") + _SAMPLERS + _HEAD + _MAPS + body


def absorbing_shader(rgb, strength: float) -> str:
    body = f"  colour = vec4(absorbed(plus.r, plus.a, {vec(rgb)}, {number(strength)}), plus.a);\n}}"
    return glsl("colour") + _SAMPLERS + _HEAD + _MAPS + body


SUNS = [np.array(v) / np.linalg.norm(v) for v in ((1.0, 2.0, -1.0), (-0.3, -0.5, 0.8), (0.0, 0.0, 1.0))]
MEAN, SLOPE = np.array([0.5, 0.6, 0.7]), np.array([[0.1, 0.0, 0.2], [0.3, 0.4, 0.1], [-0.2, 0.1, 0.0]])
RGB, CONTRAST = (0.9, 0.5, 0.1), Remap(from_range=(0.1, 0.8), shape=Contrast(intensity=1.3, pivot=0.4))
SHADOW = shadow_map(
    DirectionalLight(to_light=(0.6, 0.0, 0.8), angle_deg=8.0),
    [Sphere(centre_m=(0.8, 0.1, 0.5), radius_m=0.35)],
    Grid.centred((8, 8, 8)),
    CAMERA,
    size_px=96,
)
SMOKE_M = 1.7 + 0.2 * np.linspace(0.0, 1.0, SIZE[1]) * np.ones(SIZE)
SCENE_M = 1.7 + 0.4 * np.linspace(0.0, 1.0, SIZE[0])[:, None] * np.ones(SIZE)


def ambient_shader() -> str:
    axes = ("right", "top", "front", "left", "bottom", "back")
    sky = ", ".join(vec(row) for row in (MEAN, *SLOPE))
    skies = "".join(f"  skies[{n}] = sky_of_axis({vec(TO_LIGHT[name])}, {sky});\n" for n, name in enumerate(axes))
    body = f"  vec3 skies[6];\n{skies}  colour = vec4(ambient(plus.rgb, minus, skies), plus.a);\n}}"
    return glsl("ambient") + _SAMPLERS + _HEAD + _MAPS + body


def remap_shader() -> str:
    body = "  colour = vec4(contrast(from_range(plus.r, vec2(0.1, 0.8)), 1.3, 0.4));\n}"
    return glsl("colour") + _SAMPLERS + _HEAD + _MAPS + body


def shadow_shader(soft_m: float) -> str:
    texel = 2.0 * SHADOW.camera.half_height_m / SHADOW.camera.height_px
    about = ", ".join(number(v) for v in (SHADOW.light_size, soft_m, texel, float(SHADOW.depth_m.min())))
    return (
        glsl("shadow")
        + _SAMPLERS
        + _HEAD
        + f"""
  vec3 p = texelFetch(surface, at, 0).xyz;
  colour = vec4(visible_point(depths, p.xy, p.z, {about}));
}}"""
    )


def compose_shader() -> str:
    return (
        glsl("compose")
        + _SAMPLERS
        + _HEAD
        + _MAPS
        + """
  vec3 d = texelFetch(surface, at, 0).xyz;
  vec4 smoke = cut_off(plus, part_in_front(d.x, d.y, 0.15));
  colour = vec4(over(smoke, vec3(0.2, 0.3, 0.4)), 1.0);
}"""
    )


@pytest.fixture(scope="module")
def drawn(
    maps: SixWayLightmap, surface: SmokeSurface, slab: SmokeSlab, tmp_path_factory: pytest.TempPathFactory
) -> Callable:
    """All shaders of this file, drawn by one process."""
    ordered = [DIRECTIONS.index(name) for name in ("right", "top", "front", "left", "bottom", "back")]
    six, alpha = maps.maps[..., ordered], maps["alpha"][..., None]
    pixels, depth = project(SHADOW.camera, surface.points_m)
    finite = np.where(np.isfinite(SHADOW.depth_m), SHADOW.depth_m, 1e9)[..., None]
    textures = {
        "positive": np.concatenate([six[..., :3], alpha], axis=-1),
        "negative": np.concatenate([six[..., 3:], alpha], axis=-1),
        "surface": np.concatenate([surface.points_m, alpha], axis=-1),
        "depths": np.concatenate([finite] * 4, axis=-1),
    }
    in_map = np.concatenate([pixels, depth[..., None], alpha], axis=-1)
    rays = np.concatenate([CAMERA.rays()[1], alpha], axis=-1)
    moments = np.stack([MEAN_M, SPREAD_M, MEAN_M, MEAN_M], axis=-1)
    touching = np.stack([SMOKE_M, SCENE_M, SMOKE_M, SMOKE_M], axis=-1)
    shaders = {f"sun {n} {rule}": sun_shader(sun, rule) for n, sun in enumerate(SUNS) for rule in RULES}
    shaders |= {name: lamp_shader(light) for name, light in LAMPS.items()}
    mean = float((maps["alpha"] * slab.extinction_per_m).sum() / maps["alpha"].sum())
    shaders |= {f"slab {name}": slab_shader(light, mean) for name, light in LAMPS.items()}
    shaders |= {f"absorbing {s}": absorbing_shader(RGB, s) for s in (0.0, 0.6)}
    shaders |= {"ambient": ambient_shader(), "remap": remap_shader(), "all": glsl() + _SAMPLERS + _HEAD + "}"}
    shaders |= {f"shadow {s}": shadow_shader(s) for s in (0.0, 0.1)} | {"compose": compose_shader()}
    jobs: dict[str, np.ndarray] = {}
    for name, source in shaders.items():
        jobs |= {f"{name}/source": np.array(source), f"{name}/size": np.array(SIZE)}
        own = {"shadow": in_map, "compose": touching, "slab": rays}.get(name.split()[0], textures["surface"])
        used = {key: value for key, value in (textures | {"surface": own}).items() if f"texelFetch({key}" in source}
        if name.startswith("shadow"):
            used["depths"] = textures["depths"]
        if name.startswith("slab"):
            used["depths"] = moments
        jobs |= {f"{name}/texture/{key}": value.astype(np.float32) for key, value in used.items()}
    home = tmp_path_factory.mktemp("gles")
    np.savez(home / "jobs.npz", **jobs)
    command = [sys.executable, str(Path(__file__).with_name("gles.py")), str(home / "jobs.npz"), str(home / "out.npz")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if done.returncode:
        pytest.skip(f"OpenGL ES could not be run: {done.stderr.strip().splitlines()[-1:]}")
    with np.load(home / "out.npz") as result:
        found = dict(result)
    if "unavailable" in found:
        pytest.skip(f"no OpenGL ES 3 on this machine: {found['unavailable']}")

    def of(name: str) -> np.ndarray:
        assert f"{name}/error" not in found, f"{found[f'{name}/error']}\n{shaders[name]}"
        return found[name]

    return of


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("sun", range(len(SUNS)))
def test_suns_by_every_rule(drawn: Callable, maps: SixWayLightmap, rule, sun: int) -> None:
    x, y, z = SUNS[sun].tolist()
    expected = shade(maps, [DirectionalLight(to_light=(x, y, z))], rule=rule)
    assert expected.max() > 0.3
    np.testing.assert_allclose(drawn(f"sun {sun} {rule}")[..., :3], expected, atol=1e-5)


@pytest.mark.parametrize("lamp", LAMPS)
def test_lamps(drawn: Callable, maps: SixWayLightmap, surface: SmokeSurface, lamp: str) -> None:
    expected = shade(maps, [LAMPS[lamp]], surface=surface)
    assert 0.05 < expected.max()
    np.testing.assert_allclose(drawn(lamp)[..., :3], expected, atol=0.1 * WITHIN, rtol=1e-3)


@pytest.mark.parametrize("lamp", LAMPS)
def test_lamps_in_smoke(drawn: Callable, maps: SixWayLightmap, slab: SmokeSlab, lamp: str) -> None:
    expected = shade(maps, [LAMPS[lamp]], surface=slab)
    assert 0.05 < expected.max()
    np.testing.assert_allclose(drawn(f"slab {lamp}")[..., :3], expected, atol=0.1 * WITHIN, rtol=2e-3)


@pytest.mark.parametrize("strength", [0.0, 0.6])
def test_absorption(drawn: Callable, maps: SixWayLightmap, strength: float) -> None:
    colour = SmokeColour(rgb=RGB, mode="absorption", strength=strength)
    expected = coloured(maps["right"], maps["alpha"], colour)
    np.testing.assert_allclose(drawn(f"absorbing {strength}")[..., :3], expected, atol=1e-5)


def test_remap(drawn: Callable, maps: SixWayLightmap) -> None:
    np.testing.assert_allclose(drawn("remap")[..., 0], remap_values(maps["right"], CONTRAST), atol=1e-5)


def test_ambient(drawn: Callable, maps: SixWayLightmap) -> None:
    expected = shade(maps, [], ambient=Ambient.from_sh(MEAN, SLOPE))
    np.testing.assert_allclose(drawn("ambient")[..., :3], expected, atol=1e-5)


@pytest.mark.parametrize("soft_m", [0.0, 0.1])
def test_shadows(drawn: Callable, surface: SmokeSurface, soft_m: float) -> None:
    expected = visibility(SHADOW, surface, softness_m=soft_m)
    assert 0.1 < expected.mean() < 0.95
    shown = drawn(f"shadow {soft_m}")[..., 0]
    off = np.abs(shown - expected)
    assert np.quantile(off, 0.98) <= WITHIN  # a tap on a texel's edge may fall on either side of it
    assert off.max() <= 3.5 / 24.0


def test_compositing(drawn: Callable, maps: SixWayLightmap) -> None:
    rgb = np.stack([maps[name] for name in ("right", "top", "front")], axis=-1)
    background = np.broadcast_to(np.array([0.2, 0.3, 0.4], np.float32), rgb.shape)
    expected = composed(rgb, maps["alpha"], SMOKE_M, background, SCENE_M, thickness_m=0.15)
    np.testing.assert_allclose(drawn("compose")[..., :3], expected, atol=1e-5)


def test_all_chapters_go_together(drawn: Callable) -> None:
    drawn("all")


def test_chapters_are_named() -> None:
    assert glsl().startswith("#version 300 es")
    assert all(len(glsl(name)) < len(glsl()) for name in CHAPTERS)
    with pytest.raises(ValueError, match="no GLSL chapter 'fog'; known: blend"):
        glsl("fog")
