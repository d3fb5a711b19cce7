"""Lamps in smoke and around it: one direction a pixel, and the slab behind each pixel, against traced light.

SIXWAY_REAL_VOLUMES=DIR python scripts/study_lamps.py --write

All methods take the same traced maps and alpha; what differs is what they know of the smoke's depth. `--write` makes
docs/lamps.md and its picture.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter
from study_volumes import OPTICAL_DEPTH, StudyVolume, study_volumes

from sixway.core.color import encode_srgb
from sixway.core.frames import Camera, Vector
from sixway.core.png import write_8bit_png
from sixway.core.records import SixWayLightmap
from sixway.core.store import provenance, write_text
from sixway.guide.march import GuideConfig, GuideMarcher
from sixway.reference import lights as reference
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.reference.lit import trace_lit
from sixway.shading.compose import shade
from sixway.shading.light import PointLight, SpotLight
from sixway.shading.shadow_volume import sample
from sixway.shading.slab import SmokeSlab
from sixway.shading.surface import SmokeSurface

DOCS = Path(__file__).parents[1] / "docs"
SIZE_PX = 64
WHITE = (1.0, 1.0, 1.0)
METHODS = ("first depth", "mean depth", "slab, one extinction", "slab")
TWICE = ("centre", "outside, right")
"""Traced a second time, which tells the noise of all."""
PICTURED = ("centre", "front", "beside the centre", "spot", "outside, right")
Lamp = PointLight | SpotLight
Surface = SmokeSurface | SmokeSlab


@dataclass(frozen=True, kw_only=True)
class Score:
    """brightness: sum over the picture, of the truth's. factor: by which pixels are off, up or down. psnr: dB, sRGB."""

    brightness: float
    factor: float
    psnr: float


def lamps(volume: StudyVolume, camera: Camera) -> dict[str, Lamp]:
    """In the densest place of the smoke, before it, behind it and beside it, and outside."""
    grid, density = volume.frame.grid, volume.frame.density.astype(np.float64)
    blurred = gaussian_filter(density, 0.08 * max(density.shape), mode="constant")
    densest = np.array(np.unravel_index(np.argmax(blurred), density.shape))[::-1]
    middle = np.array(grid.origin_m) + (densest + 0.5) * grid.voxel_size_m

    def moved(x: float, y: float, z: float) -> np.ndarray:
        """Relative to the densest place, camera frame; the box is 1 m long."""
        return middle + np.array(camera.to_world((x, y, z)))

    def in_column(point: np.ndarray, share: float) -> np.ndarray:
        """Where the ray through that point has met this share of its smoke."""
        eye = np.array(camera.position_m)
        towards = (point - eye) / np.linalg.norm(point - eye)
        along = camera.distance_m + np.linspace(-1.2, 1.2, 600) * grid.radius_m
        points = eye + along[:, None] * towards
        met = np.cumsum(sample(density, grid, points))
        return points[int(np.searchsorted(met, share * met[-1]))]

    def point(place: np.ndarray) -> PointLight:
        return PointLight(position_m=vector(place), intensity=WHITE)

    centre = in_column(middle, 0.5)
    return {
        "centre": point(centre),
        "front": point(in_column(middle, 0.1)),
        "back": point(in_column(middle, 0.9)),
        "beside the centre": point(in_column(moved(0.12, 0.15, 0.0), 0.5)),
        "beside, front": point(in_column(moved(-0.15, -0.1, 0.0), 0.25)),
        "spot": SpotLight(
            position_m=vector(in_column(moved(-0.08, 0.05, 0.0), 0.3)),
            towards=camera.to_world((0.8, -0.6, 0.0)),
            intensity=WHITE,
            cutoff_deg=40.0,
            beam_deg=20.0,
        ),
        "just outside, front": point(in_column(middle, 0.002) + np.array(camera.to_world((0.0, 0.0, 0.05)))),
        "outside, front": point(moved(0.2, 0.2, 0.7)),
        "outside, right": point(moved(0.7, 0.1, 0.1)),
        "outside, behind": point(moved(-0.2, 0.3, -0.7)),
    }


def vector(place: np.ndarray) -> Vector:
    x, y, z = place.tolist()
    return (x, y, z)


def surfaces(volume: StudyVolume, camera: Camera, alpha: np.ndarray) -> dict[str, Surface]:
    """What each method knows of the smoke."""
    slab = SmokeSlab.from_frame(volume.frame, volume.medium, camera)
    depth = slab.optical_depth
    mean = slab.begins_m + slab.thickness_m * (1.0 / depth - 1.0 / np.expm1(depth))
    density = volume.frame.density.astype(np.float64)
    extinction = float((density**2).sum() / density.sum()) * volume.medium.extinction_per_m
    thickness = depth / extinction
    first = GuideMarcher(GuideConfig(), volume.medium, device="cpu").march(volume.frame, camera, seed=0).depth_m
    return {
        "first depth": SmokeSurface.from_depth(camera, first),
        "mean depth": SmokeSurface.from_depth(camera, mean),
        "slab, one extinction": SmokeSlab(
            camera=camera,
            begins_m=mean - thickness * (1.0 / depth - 1.0 / np.expm1(depth)),
            thickness_m=thickness,
            optical_depth=depth,
        ),
        "slab": slab,
    }


def traced(volume: StudyVolume, camera: Camera, lamp: Lamp, *, samples: int, seed: int) -> np.ndarray:
    light: reference.Light
    if isinstance(lamp, SpotLight):
        light = reference.SpotLight(
            position_m=lamp.position_m,
            towards=lamp.towards,
            intensity=WHITE,
            cutoff_deg=lamp.cutoff_deg,
            beam_deg=lamp.beam_deg,
        )
    else:
        light = reference.PointLight(position_m=lamp.position_m, intensity=WHITE)
    return trace_lit(volume.frame, camera, volume.medium, [light], samples=samples, seed=seed, device="cpu")[..., 0]


def averaged(picture: np.ndarray) -> np.ndarray:
    side = SIZE_PX // 2
    return picture.reshape(side, 2, side, 2).mean(axis=(1, 3))


def shown(picture: np.ndarray, white: float) -> np.ndarray:
    return np.clip(encode_srgb(np.maximum(picture, 0.0) / white), 0.0, 1.0)


def score(picture: np.ndarray, truth: np.ndarray) -> Score:
    """Over 2 x 2 pixels against noise; the factor over pixels above 2 % of white, weighted as the eye does, by root.

    What is below 0.5 % of white is black to the eye: it counts as 0.5 %.
    """
    picture, truth = averaged(picture), averaged(truth)
    white = float(np.percentile(truth, 99.5))
    lit = truth > 0.02 * white
    off = np.abs(np.log(np.maximum(picture[lit], 0.005 * white) / truth[lit]))
    error = float(((shown(picture, white) - shown(truth, white)) ** 2).mean())
    return Score(
        brightness=float(picture.sum() / truth.sum()),
        factor=math.exp(float(np.average(off, weights=np.sqrt(truth[lit])))),
        psnr=-10.0 * math.log10(max(error, 1e-12)),
    )


def main() -> int:
    options = parser(__doc__.splitlines()[0])
    options.add_argument("--write", action="store_true", help="make docs/lamps.md and its picture")
    chosen = options.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    samples = 32 if chosen.quick else 128
    result = Measurement({"size_px": SIZE_PX, "samples": samples}, repetitions=1)
    scores: dict[str, dict[str, list[Score]]] = {}
    noise: list[Score] = []
    rows: list[tuple[str, list[np.ndarray]]] = []
    volumes = study_volumes(quick=chosen.quick)
    for volume in volumes:
        camera = Camera.around(
            volume.frame.grid, yaw_deg=25.0, pitch_deg=10.0, margin=0.9, width_px=SIZE_PX, height_px=SIZE_PX
        )
        tracer = LightmapTracer(ReferenceConfig(samples=16), volume.medium, device="cpu")
        maps: SixWayLightmap = tracer.trace(volume.frame, camera, seed=0)
        known = surfaces(volume, camera, maps["alpha"])
        for name, lamp in lamps(volume, camera).items():
            truth = traced(volume, camera, lamp, samples=samples, seed=1)
            if name in TWICE:
                noise.append(score(traced(volume, camera, lamp, samples=samples, seed=2), truth))
            pictures = {method: shade(maps, [lamp], surface=known[method])[..., 0] for method in METHODS}
            place = scores.setdefault(name, {method: [] for method in METHODS})
            for method, picture in pictures.items():
                place[method].append(score(picture, truth))
            if name in PICTURED and volume.name in ("explosion", volumes[0].name):
                white = float(np.percentile(averaged(truth), 99.5))
                rows.append((f"{volume.name}, {name}", [shown(p, white) for p in (truth, *pictures.values())]))
        print(volume.name, file=sys.stderr, flush=True)
    inside = [name for name in scores if "outside" not in name and name != "spot"]
    outside = [name for name in scores if "outside" in name]
    for where, names in (("inside", inside), ("outside", outside)):
        for method in METHODS:
            bound = {"inside": 1.6, "outside": 1.4}[where] if method == "slab" else None
            result.add(f"{where}, {method}: pixels off by", over(scores, names, method, off_by), "x", at_most=bound)
            result.add(f"{where}, {method}: PSNR", over(scores, names, method, mean_psnr), "dB")
    result.add("outside, slab over first depth: PSNR", gain(scores, outside), "dB", at_least=0.0)
    result.add("traced again: pixels off by", off_by(noise), "x")
    if chosen.write:
        write_text(DOCS / "lamps.md", page(scores, noise, inside, outside, [v.name for v in volumes], samples))
        write_8bit_png(DOCS / "images/lamps.png", sheet(rows))
    return result.finish(chosen.json)


Mean = Callable[[list[Score]], float]


def off_by(found: list[Score]) -> float:
    return math.exp(float(np.mean([math.log(one.factor) for one in found])))


def brightness(found: list[Score]) -> float:
    return math.exp(float(np.mean([math.log(one.brightness) for one in found])))


def mean_psnr(found: list[Score]) -> float:
    return float(np.mean([one.psnr for one in found]))


def over(scores: dict[str, dict[str, list[Score]]], names: list[str], method: str, mean: Mean) -> float:
    return mean([one for name in names for one in scores[name][method]])


def gain(scores: dict[str, dict[str, list[Score]]], names: list[str]) -> float:
    return over(scores, names, "slab", mean_psnr) - over(scores, names, "first depth", mean_psnr)


def page(
    scores: dict[str, dict[str, list[Score]]],
    noise: list[Score],
    inside: list[str],
    outside: list[str],
    volumes: list[str],
    samples: int,
) -> str:
    pairs = [(name, before, after) for name in scores for before, after in zip(
        scores[name]["first depth"], scores[name]["slab"], strict=True
    )]  # fmt: skip
    cases = [(f"{volumes[n % len(volumes)]}, {pair[0]}", *pair[1:]) for n, pair in enumerate(pairs)]
    worse = sorted((c for c in cases if c[2].psnr < c[1].psnr - 0.2), key=lambda c: c[2].psnr - c[1].psnr)

    def table(mean: Mean) -> list[str]:
        lines = [
            f"| {name} | " + " | ".join(f"{mean(scores[name][method]):.2f}" for method in METHODS) + " |"
            for name in scores
        ]
        for where, names in (("inside", inside), ("outside", outside)):
            cells = " | ".join(f"**{over(scores, names, method, mean):.2f}**" for method in METHODS)
            lines.append(f"| **{where}** | {cells} |")
        return [f"| lamp | {' | '.join(METHODS)} |", f"|---|{'---|' * len(METHODS)}", *lines, ""]

    made = provenance()
    return "\n".join(
        [
            "# Lamps in smoke, measured",
            "",
            "Made by `python scripts/study_lamps.py --write`; do not edit. "
            f"Commit {made['commit']}, {made['hardware']}.",
            "",
            f"Point lamps and one spot against `trace_lit` (one indirect bounce, {samples} paths a pixel, {SIZE_PX} x "
            f"{SIZE_PX} px, optical depth {OPTICAL_DEPTH:g}), {len(volumes)} volumes ({', '.join(volumes)}). Maps are "
            "traced, so that nothing but the lamp's model differs. Pictures are averaged over 2 x 2 px. The truth "
            f"traced again is off by {off_by(noise):.2f}, {mean_psnr(noise):.1f} dB: no model could do better.",
            "",
            "- `first depth`: one direction a pixel, from where the ray meets smoke (`SmokeSurface`, the guide's "
            "depth).",
            "- `mean depth`: the same from where the ray ends on average.",
            "- `slab, one extinction`: mean depth and one extinction for the whole picture.",
            "- `slab`: mean and spread of the depth, two numbers a pixel (`SmokeSlab.from_frame`).",
            "",
            "Pixels are off by this factor, up or down (geometric mean over volumes; pixels above 2 % of white, weight "
            "root of the truth; below 0.5 % counts as 0.5 %):",
            "",
            *table(off_by),
            "Brightness of the whole picture, of the truth's (geometric mean):",
            "",
            *table(brightness),
            "PSNR [dB] in sRGB, 99.5th percentile of the truth at white:",
            "",
            *table(mean_psnr),
            f"Of {len(cases)} cases, `slab` has a lower PSNR than `first depth` by more than 0.2 dB in {len(worse)}"
            + (":" if worse else "."),
            "",
            *[
                f"- {name}: {before.psnr:.1f} to {after.psnr:.1f} dB (pixels off by {before.factor:.2f} to "
                f"{after.factor:.2f}; brightness {before.brightness:.2f} to {after.brightness:.2f})."
                for name, before, after in worse
            ],
            "",
            "A spot's light that scatters out of its cone is missing: no model here knows of it, and it is most of "
            "what makes `spot` the worst row. The means of `inside` are those of point lamps; with the spot pixels are "
            f"off by {over(scores, [*inside, 'spot'], 'slab', off_by):.2f}. Behind thick smoke lamps come out too "
            "bright, probably because six maps have too much of light that comes from behind and aslant. How much "
            "scatters twice, and the extinction between pixel and lamp, were chosen on these very volumes.",
            "",
            f"![truth, {', '.join(METHODS)}](images/lamps.png)",
            "",
            f"Columns: truth, {', '.join(METHODS)}.",
            "",
        ]
    )


def sheet(rows: list[tuple[str, list[np.ndarray]]]) -> np.ndarray:
    """Rows of pictures at twice their size, with a title above each column and a name in each row."""
    tiles = [np.concatenate([np.pad(tile, 1, constant_values=0.2) for tile in row], axis=1) for _, row in rows]
    grey = Image.fromarray((np.concatenate(tiles) * 255.0 + 0.5).astype(np.uint8))
    grey = grey.resize((2 * grey.width, 2 * grey.height), Image.Resampling.NEAREST)
    titled = Image.new("L", (grey.width, grey.height + 18), 24)
    titled.paste(grey, (0, 18))
    draw, step, height = ImageDraw.Draw(titled), grey.width // len(rows[0][1]), grey.height // len(rows)
    for column, title in enumerate(("truth", *METHODS)):
        draw.text((column * step + 4, 3), title, fill=220)
    for number, (name, _) in enumerate(rows):
        draw.text((4, 18 + number * height + 3), name, fill=160)
    return np.asarray(titled)[..., None]


if __name__ == "__main__":
    sys.exit(main())
