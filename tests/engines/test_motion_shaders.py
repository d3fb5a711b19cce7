"""The shaders for engines, run in a real OpenGL ES 3: each shows what NumPy shows, from the same textures.

HLSL and Godot's language have no compiler here: their few own words are written as GLSL's, nothing else is changed.
"""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sixway.core.conventions import DIRECTIONS
from sixway.engines.flipbook import TileGrid, place
from sixway.engines.motion import blend
from sixway.engines.packing import PACKINGS, pack
from sixway.shading.blend import blend_weights
from sixway.shading.shader import glsl

SHADERS = Path(__file__).parents[2] / "sixway/engines/shaders"
RUNNER = Path(__file__).parents[1] / "shading/gles.py"
HEIGHT, WIDTH, FRAMES = 6, 8, 3
GRID = TileGrid(2, 2)
SCALE = 0.5  # of a tile: 4 px across, 3 px down
LIGHT, SKY, FIRE = np.array([0.9, 0.6, 0.3]), np.array([0.1, 0.2, 0.4]), np.array([2.0, 0.7, 0.1])
TO_LIGHT = np.array([0.48, -0.6, 0.64])
NAMES = (*DIRECTIONS, "alpha", "emissive")


@pytest.fixture(scope="module")
def frames() -> tuple[np.ndarray, np.ndarray]:
    """Random frames [n, h, w, 8], and flows that are whole pixels at half the way [n, h, w, 2; right, down]."""
    rng = np.random.default_rng(7)
    image = rng.uniform(0.0, 1.0, (FRAMES, HEIGHT, WIDTH, 8)).astype(np.float32)
    flow = np.stack(
        [rng.choice([-4.0, -2.0, 0.0, 2.0, 4.0], image.shape[:3]), rng.choice([-2.0, 0.0, 2.0], image.shape[:3])], -1
    )
    return image, flow.astype(np.float32)


def textures(image: np.ndarray, flow: np.ndarray, y: str) -> dict[str, np.ndarray]:
    """Books as an engine samples them, linear, row 0 on top."""
    coded = 0.5 + 0.5 * flow / (SCALE * np.array([WIDTH, -HEIGHT if y == "up" else HEIGHT]))
    blank = np.zeros((*coded.shape[:3], 2))
    pair = [*pack(image, NAMES, PACKINGS["unity"]), np.concatenate([coded, blank], -1)]
    books = {}
    for name, pictures in zip(("rtba", "lbfe", "motion"), pair, strict=True):
        books[name] = np.zeros((GRID.rows * HEIGHT, GRID.columns * WIDTH, 4), np.float32)
        for number, picture in enumerate(pictures):
            place(books[name], picture, number, GRID)
    return books


def expected(image: np.ndarray, flow: np.ndarray, first: int, second: int) -> np.ndarray:
    shown = blend(image[first], image[second], flow[first], flow[second], 0.5)
    maps = shown[..., :6]
    lit = maps @ blend_weights(TO_LIGHT, "squared")
    rgb = lit[..., None] * LIGHT + 4.0 / 6.0 * maps.sum(-1)[..., None] * SKY + shown[..., 7:] * FIRE
    return np.concatenate([rgb, shown[..., 6:7]], axis=-1)


def vec(values) -> str:
    return f"vec{len(values)}({', '.join(f'{float(value):.9g}' for value in values)})"


def glsl_sprite(*, time: float, loops: bool, y: str) -> str:
    text = glsl("blend") + (SHADERS / "flipbook.glsl").read_text() + (SHADERS / "sprite.glsl").read_text()
    constants = f"""
const vec2 grid = vec2(2.0), tile_px = {vec((WIDTH, HEIGHT))};
const vec2 motion_scale = {vec((SCALE, -SCALE if y == "up" else SCALE))};
const float time = float({time}), frames = float({FRAMES});
const bool loops = {str(loops).lower()};
const vec3 to_light = {vec(TO_LIGHT)}, light = {vec(LIGHT)}, sky = {vec(SKY)}, fire = {vec(FIRE)};
vec2 uv;"""
    samplers = "uniform sampler2D rtba, lbfe, motion;"
    before, after = text.split(samplers)
    after = after[after.index("out vec4 colour;") :]
    after = after.replace("void main() {", f"void main() {{\n  uv = gl_FragCoord.xy / {vec((WIDTH, HEIGHT))};")
    return before + samplers + constants + after


_GL_HEAD = "#version 300 es\nprecision highp float;\nprecision highp sampler2D;\nout vec4 colour;\n"
_HLSL_HEAD = (
    _GL_HEAD
    + "#define float2 vec2\n#define float3 vec3\n#define float4 vec4\n#define lerp mix\n#define ddx dFdx\n"
    + "#define ddy dFdy\n#define SAMPLE_TEXTURE2D_GRAD(t, s, c, x, y) textureGrad(t, c, x, y)\n"
    + "uniform sampler2D rtba, lbfe, motion;\n"
)


def godot_sprite(*, time: float, y: str) -> str:
    text = (SHADERS / "six_way.gdshader").read_text()
    values = {
        "grid": vec((2, 2)),
        "tile_px": vec((WIDTH, HEIGHT)),
        "motion_scale": vec((SCALE, -SCALE if y == "up" else SCALE)),
        "frames": f"float({FRAMES})",
        "fps": "10.0",
        "loops": "true",
        "map_gain": "1.0",
        "sky": vec(SKY),
        "fire": vec(FIRE),
    }
    text = re.sub(r"^(shader_type|render_mode) .*?;", "", text, flags=re.M)
    text = re.sub(r"^uniform sampler2D (\w+) :.*;", r"uniform sampler2D \1;", text, flags=re.M)
    for name, value in values.items():
        text, count = re.subn(rf"^uniform (\w+) {name} = .*;", rf"const \1 {name} = {value};", text, flags=re.M)
        assert count == 1, name
    assert " uniform " not in text
    head = f"""
const float PI = 3.14159265;
vec2 UV;
float TIME = float({time / 10.0}), ALPHA, ATTENUATION = 1.0;
vec3 TANGENT = vec3(1.0, 0.0, 0.0), NORMAL = vec3(0.0, 0.0, 1.0), LIGHT = {vec(TO_LIGHT)}, ALBEDO, EMISSION;
vec3 LIGHT_COLOR = {vec(LIGHT * np.pi)}, DIFFUSE_LIGHT = vec3(0.0);
"""
    main = f"""
void main() {{
  UV = gl_FragCoord.xy / {vec((WIDTH, HEIGHT))};
  fragment();
  light();
  colour = vec4(DIFFUSE_LIGHT * ALBEDO + EMISSION, ALPHA);
}}"""
    return _GL_HEAD + head + text.replace("varying ", "") + main


def turned() -> tuple[str, str, str, str]:
    """The light and the axes of the sprite in a world that is turned: only their products count."""
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return vec(TO_LIGHT @ axes), vec(axes[0]), vec(axes[1]), vec(axes[2])


def unity_sprite(*, time: float) -> str:
    text = (SHADERS / "six_way_unity.hlsl").read_text().replace("UnityTexture2D", "sampler2D")
    text = text.replace(".tex,", ",").replace(".samplerstate", "")
    to_light, right, up, viewer = turned()
    main = f"""
void main() {{
  vec3 rgb;
  float alpha;
  SixWaySprite_float(rtba, lbfe, motion, gl_FragCoord.xy / {vec((WIDTH, HEIGHT))}, vec2(2.0), {vec((WIDTH, HEIGHT))},
    {vec((SCALE, SCALE))}, float({time}), float({FRAMES}), 1.0, {to_light}, {right}, {up}, {viewer},
    {vec(LIGHT)}, {vec(SKY)}, {vec(FIRE)}, rgb, alpha);
  colour = vec4(rgb, alpha);
}}"""
    return _HLSL_HEAD + text + main


def unreal_sprite(*, time: float, y: str) -> str:
    body = (SHADERS / "six_way_unreal.hlsl").read_text()
    body = re.sub(r"(\w+)\.SampleGrad\(\w+, ", r"textureGrad(\1, ", body)
    to_light, right, up, viewer = turned()
    inputs = f"""
#define RTBA rtba
#define LBFE lbfe
#define MV motion
vec4 custom(vec2 UV) {{
  vec2 Grid = vec2(2.0), TilePx = {vec((WIDTH, HEIGHT))}, MotionScale = {vec((SCALE, -SCALE if y == "up" else SCALE))};
  float Time = float({time}), Frames = float({FRAMES}), Loops = 1.0;
  vec3 ToLight = {to_light}, Right = {right}, Up = {up}, ToViewer = {viewer};
  vec3 LightColour = {vec(LIGHT)}, Sky = {vec(SKY)}, Fire = {vec(FIRE)};
"""
    return (
        _HLSL_HEAD + inputs + body + f"}}\nvoid main() {{ colour = custom(gl_FragCoord.xy / {vec((WIDTH, HEIGHT))}); }}"
    )


CASES = {
    "glsl": (glsl_sprite(time=1.5, loops=False, y="down"), "down", (1, 2)),
    "glsl, y up": (glsl_sprite(time=0.5, loops=False, y="up"), "up", (0, 1)),
    "glsl, the loop closes": (glsl_sprite(time=5.5, loops=True, y="down"), "down", (2, 0)),
    "glsl, the end stays": (glsl_sprite(time=7.5, loops=False, y="down"), "down", None),
    "godot": (godot_sprite(time=1.5, y="down"), "down", (1, 2)),
    "godot, y up": (godot_sprite(time=2.5, y="up"), "up", (2, 0)),
    "unity": (unity_sprite(time=1.5), "up", (1, 2)),
    "unity, the loop closes": (unity_sprite(time=2.5), "up", (2, 0)),
    "unreal": (unreal_sprite(time=1.5, y="down"), "down", (1, 2)),
    "unreal, y up": (unreal_sprite(time=3.5, y="up"), "up", (0, 1)),
}


@pytest.fixture(scope="module")
def drawn(frames, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """All shaders drawn by one process."""
    jobs: dict[str, np.ndarray] = {}
    for name, (source, y, _) in CASES.items():
        jobs[f"{name}/source"], jobs[f"{name}/size"] = np.array(source), np.array([HEIGHT, WIDTH])
        for texture, picture in textures(*frames, y).items():
            # Unity's v points up: its textures begin with the lowest row
            jobs[f"{name}/texture/{texture}"] = picture[::-1] if name.startswith("unity") else picture
    folder = tmp_path_factory.mktemp("engines")
    np.savez(folder / "jobs.npz", **jobs)
    command = [sys.executable, str(RUNNER), str(folder / "jobs.npz"), str(folder / "result.npz")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if run.returncode:
        pytest.skip(f"OpenGL ES 3 does not run here: {run.stderr[-300:]}")
    with np.load(folder / "result.npz") as results:
        if "unavailable" in results:
            pytest.skip(str(results["unavailable"]))
        return dict(results)


@pytest.mark.parametrize("name", CASES)
def test_shaders_show_what_numpy_shows(name: str, drawn: dict[str, np.ndarray], frames) -> None:
    assert f"{name}/error" not in drawn, drawn[f"{name}/error"]
    _, _, pair = CASES[name]
    got = drawn[name][::-1] if name.startswith("unity") else drawn[name]
    image, flow = frames
    if pair is None:  # past the end: the last frame, still
        pair, flow = (FRAMES - 1, FRAMES - 1), 0.0 * flow
    np.testing.assert_allclose(got, expected(image, flow, *pair), atol=1e-5)
