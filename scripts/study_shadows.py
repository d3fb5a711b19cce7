"""Shadows of solids on smoke: the paper's depth shell and the march through the smoke against traced light.

SIXWAY_REAL_VOLUMES=DIR python scripts/study_shadows.py --write

Both multiply the picture that was traced without the solids, so that nothing but the shadow differs from the truth.
`--write` makes docs/shadows.md and its picture.
"""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser
from PIL import Image, ImageDraw
from study_volumes import OPTICAL_DEPTH, StudyVolume, study_volumes

from sixway.core.color import encode_srgb
from sixway.core.conventions import Bounces
from sixway.core.frames import Camera, Vector
from sixway.core.png import write_8bit_png
from sixway.core.solids import Box, Cylinder, Obstacle, Sphere
from sixway.core.store import write_text
from sixway.reference import lights as reference
from sixway.reference.lit import trace_lit
from sixway.shading.light import DirectionalLight, Light, PointLight
from sixway.shading.near import arriving
from sixway.shading.shadow_map import shadow_map, visibility
from sixway.shading.shadow_volume import LightDepth, march_rays, shadowed_share
from sixway.shading.solid_depth import solid_depth
from sixway.shading.surface import SmokeSurface

DOCS = Path(__file__).parents[1] / "docs"
SIZE_PX, SAMPLES = 64, 96
SHELL_BEGINS = 0.02
"""The shell lies where this part of a ray has ended; the guide's lies at a thousandth of the peak density."""
METHODS = ("no shadow", "shell", "shell, 0.05 m soft", "march", "march, filled")


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One light and its solids. Places are relative to the middle of the smoke's box, 1 m long, camera frame."""

    name: str
    light: Light
    traced: reference.Light
    solids: tuple[Obstacle, ...]


def scenes(camera: Camera) -> list[Scene]:
    """A ball, a pole and a wall in a sun from the right, a wide sun, and a lamp."""

    def world(x: float, y: float, z: float) -> Vector:
        return camera.to_world((x, y, z))

    right = (0.8, 0.6, 0.0)
    ball = Sphere(centre_m=world(0.64, 0.48, 0.0), radius_m=0.2)
    pole = Cylinder(start_m=world(0.7, -1.5, 0.1), end_m=world(0.7, 1.5, 0.1), radius_m=0.08)
    slab = Box(centre_m=world(1.2, 0.9, -0.75), size_m=(1.3, 1.3, 1.3))
    lamp = world(1.6, 0.4, 0.6)
    strong = (8.0, 8.0, 8.0)

    def sun(angle_deg: float) -> tuple[DirectionalLight, reference.DirectionalLight]:
        one = DirectionalLight(to_light=right, angle_deg=angle_deg)
        return one, reference.DirectionalLight(to_light=right, angle_deg=angle_deg)

    between = world(0.8, 0.2, 0.3)
    return [
        Scene(name="ball, sun", light=sun(0)[0], traced=sun(0)[1], solids=(ball,)),
        Scene(name="pole, sun", light=sun(0)[0], traced=sun(0)[1], solids=(pole,)),
        Scene(name="slab behind, sun", light=sun(0)[0], traced=sun(0)[1], solids=(slab,)),
        Scene(name="ball, sun 15 deg wide", light=sun(15)[0], traced=sun(15)[1], solids=(ball,)),
        Scene(
            name="ball, lamp",
            light=PointLight(position_m=lamp, intensity=strong),
            traced=reference.PointLight(position_m=lamp, intensity=strong),
            solids=(Sphere(centre_m=between, radius_m=0.12),),
        ),
    ]


def shell(volume: StudyVolume, camera: Camera, light: Light) -> SmokeSurface:
    """Where each ray meets smoke: what the guide's metric depth tells."""
    sigma_t = volume.frame.density * np.float32(volume.medium.extinction_per_m)
    march = march_rays(
        sigma_t, volume.frame.grid, camera, LightDepth(light, sigma_t, volume.frame.grid, camera, cells=8), steps=96
    )
    begun = np.cumsum(march.seen, axis=-1) > SHELL_BEGINS
    first = np.take_along_axis(march.points_m, begun.argmax(axis=-1)[..., None, None], axis=2)[:, :, 0]
    origins, towards = camera.rays()
    depth = ((first - origins) * towards).sum(axis=-1)
    return SmokeSurface.from_depth(camera, np.where(begun.any(axis=-1), depth, np.inf))


def shares(scene: Scene, volume: StudyVolume, camera: Camera, free: np.ndarray) -> dict[str, tuple[np.ndarray, float]]:
    """What each method leaves of the light, and its seconds. free: the picture without solids."""
    surface = shell(volume, camera, scene.light)
    light, solids = scene.light, scene.solids
    arrived = free
    if isinstance(light, PointLight):
        arrived = free * np.pi / arriving(light, surface.points_m)[1][..., 0]
    found: dict[str, tuple[np.ndarray, float]] = {"no shadow": (np.ones_like(free), 0.0)}
    for name in METHODS[1:]:
        start = time.perf_counter()
        if name.startswith("shell"):
            soft = 0.05 if "soft" in name else 0.0
            left = visibility(shadow_map(light, solids, volume.frame.grid, camera), surface, softness_m=soft)
        else:
            filled = arrived if "filled" in name else None
            left = shadowed_share(light, solids, volume.frame, volume.medium, camera, arrived=filled)
        found[name] = (left, time.perf_counter() - start)
    return found


def traced(
    scene: Scene, volume: StudyVolume, camera: Camera, solids: Sequence[Obstacle], bounces: Bounces
) -> np.ndarray:
    picture = trace_lit(
        volume.frame, camera, volume.medium, [scene.traced], obstacles=solids, bounces=bounces, samples=SAMPLES
    )
    return picture[..., 0]


def averaged(picture: np.ndarray) -> np.ndarray:
    """Over 2 x 2 pixels: shadows are smoother than noise."""
    side = SIZE_PX // 2
    return picture.reshape(side, 2, side, 2).mean(axis=(1, 3))


def psnr(a: np.ndarray, b: np.ndarray, seen: np.ndarray) -> float:
    return float(-10.0 * np.log10(max(float(((a - b)[seen] ** 2).mean()), 1e-12)))


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--write", action="store_true", help="make docs/shadows.md and its picture")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    result = Measurement({"size_px": SIZE_PX, "samples": SAMPLES}, repetitions=1)
    volumes = study_volumes(quick=chosen.quick)
    volumes = [volumes[0]] if chosen.quick else [volumes[n] for n in (0, 3, -1)]
    scores: dict[str, dict[str, list[float]]] = {}
    seconds: dict[str, list[float]] = {}
    tiles: list[list[np.ndarray]] = []
    for volume in volumes:
        camera = Camera.around(
            volume.frame.grid, yaw_deg=25.0, pitch_deg=10.0, margin=0.9, width_px=SIZE_PX, height_px=SIZE_PX
        )
        for scene in scenes(camera):
            start = time.perf_counter()
            free = traced(scene, volume, camera, (), "paper")
            truth = traced(scene, volume, camera, scene.solids, "paper")
            seconds.setdefault("traced", []).append(0.5 * (time.perf_counter() - start))
            exposure = 1.0 / np.percentile(free, 99.9)
            hidden = np.isfinite(solid_depth(scene.solids, camera)).astype(float)
            seen = averaged(hidden) == 0.0  # smoke behind a solid is another question

            def shown(picture: np.ndarray, exposure: float = exposure) -> np.ndarray:
                return np.clip(encode_srgb(averaged(picture) * exposure), 0.0, 1.0)

            row = [shown(free), shown(truth)]
            for name, (left, spent) in shares(scene, volume, camera, free).items():
                score = psnr(shown(free * left), shown(truth), seen)
                scores.setdefault(scene.name, {}).setdefault(name, []).append(score)
                seconds.setdefault(name, []).append(spent)
                if name != "no shadow":
                    row.append(shown(free * left))
            tiles.append(row)
            print(f"{volume.name}, {scene.name}", file=sys.stderr, flush=True)
    for name in METHODS:
        result.add(f"{name}, mean", float(np.mean([np.mean(s[name]) for s in scores.values()])), "dB")
        result.add(f"{name}, time", float(np.median(seconds[name])), "s")
    result.add("traced with 96 paths, time", float(np.median(seconds["traced"])), "s")
    if chosen.write:
        write_text(DOCS / "shadows.md", page(scores, seconds, [v.name for v in volumes]))
        write_8bit_png(DOCS / "images/shadows.png", sheet(tiles[: len(scores)]))
    return result.finish(chosen.json)


def page(scores: dict[str, dict[str, list[float]]], seconds: dict[str, list[float]], volumes: list[str]) -> str:
    rows = [f"| {name} | " + " | ".join(f"{np.mean(s[m]):.2f}" for m in METHODS) + " |" for name, s in scores.items()]
    means = [float(np.mean([np.mean(s[m]) for s in scores.values()])) for m in METHODS]
    times = [float(np.median(seconds[m])) for m in METHODS]
    return "\n".join(
        [
            "# Shadows of solids on smoke, measured",
            "",
            "Made by `python scripts/study_shadows.py`; do not edit.",
            "",
            f"PSNR [dB] in sRGB against `trace_lit` with the solids (one indirect bounce, {SAMPLES} paths a pixel, "
            f"{SIZE_PX} x {SIZE_PX} px, optical depth {OPTICAL_DEPTH:g}), mean of {len(volumes)} volumes "
            f"({', '.join(volumes)}). Each method multiplies the picture traced without the solids. Pixels where a "
            "solid itself is seen are left out; pictures are averaged over 2 x 2 px "
            "against noise. Truth and free picture share their random numbers, so their noise mostly cancels.",
            "",
            f"| scene | {' | '.join(METHODS)} |",
            f"|---|{'---|' * len(METHODS)}",
            *rows,
            "| **mean** | " + " | ".join(f"**{mean:.2f}**" for mean in means) + " |",
            "| median time, NumPy on one busy core [s] | " + " | ".join(f"{spent:.2f}" for spent in times) + " |",
            "",
            f"Tracing one of these pictures took {np.median(seconds['traced']):.1f} s (median).",
            "",
            "- `shell`: the point where each ray has met 2 % of its smoke, against a shadow map of 256^2 texels (the "
            "paper's way); `0.05 m soft` blurs its edge.",
            "- `march`: 48 points along each ray, each with the light that reaches it through the smoke, against the "
            "same shadow map (`shadow_volume.shadowed_share`).",
            "- `march, filled`: what the maps hold beyond single scattering is shadowed as light that comes from one "
            "mean free path around.",
            "",
            "![without solids, truth, and the four methods, scene by scene](images/shadows.png)",
            "",
            "Columns: without solids, truth, shell, soft shell, march, march filled.",
            "",
        ]
    )


def sheet(tiles: list[list[np.ndarray]]) -> np.ndarray:
    """Rows of pictures at four times their size, with a title above each column."""
    rows = [np.concatenate([np.pad(tile, 1, constant_values=0.2) for tile in row], axis=1) for row in tiles]
    grey = Image.fromarray((np.concatenate(rows) * 255.0 + 0.5).astype(np.uint8))
    grey = grey.resize((4 * grey.width, 4 * grey.height), Image.Resampling.NEAREST)
    titled = Image.new("L", (grey.width, grey.height + 18), 24)
    titled.paste(grey, (0, 18))
    draw, step = ImageDraw.Draw(titled), grey.width // len(tiles[0])
    for column, title in enumerate(("no solids", "truth", *METHODS[1:])):
        draw.text((column * step + 4, 3), title, fill=220)
    return np.asarray(titled)[..., None]


if __name__ == "__main__":
    sys.exit(main())
