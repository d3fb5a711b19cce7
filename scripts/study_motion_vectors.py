"""How few frames may a flipbook keep? In-between frames from linear blending and from motion vectors, against the bake.

python scripts/study_motion_vectors.py --write

Takes the bakes of scripts/make_flipbooks.py (`--work`, made where they are missing), keeps every 2nd, 4th and 8th
frame, and remakes those left out. `--write` makes docs/engines/motion_vectors.md and its picture.

Hardware and time: 2 CPU cores, about 3 min beside other work, once the bakes are there.
"""

import sys
from pathlib import Path

import numpy as np
from jaxtyping import Float
from make_flipbooks import RECIPES, baked
from measurement import Measurement, parser, write_section
from PIL import Image, ImageDraw

from sixway.core.color import encode_srgb
from sixway.core.conventions import DIRECTIONS, LIGHTMAP_CHANNELS
from sixway.core.exr import read_exr
from sixway.core.png import to_8bit, write_8bit_png
from sixway.engines.flipbook import decimate, every_frame
from sixway.engines.motion import FLOW_CHANNELS, blend, decoded, motion_vectors
from sixway.metrics.psnr import mse, summarise_psnr
from sixway.pack import estimated_flows

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/engines/motion_vectors.md"
PICTURE = ROOT / "docs/images/motion_vectors.png"
STEPS = (2, 4, 8)
CHANNELS = LIGHTMAP_CHANNELS[:-1]
_ALPHA = CHANNELS.index("alpha")
_SEEN = 0.02
METHODS = {
    "held": "the last frame stays",
    "linear": "two frames mixed",
    "estimated": "motion vectors, estimated from all frames",
    "from kept": "motion vectors, estimated from the kept frames alone",
    "simulated": "motion vectors, from the simulator's wind",
}

Frames = Float[np.ndarray, "n h w c"]


def remade(
    images: Frames, every: int, method: str, flows: Frames | None = None
) -> tuple[list[int], list[Float[np.ndarray, "h w c"]]]:
    """Numbers of the frames that were left out, and what a shader shows in their place. Vectors are those of a file of
    8 bits. flows: [px; right, down] of every source frame, or of every kept one."""
    shown = None
    if flows is not None:
        plan, span, alphas = decimate(every_frame(len(images)), every), float(every), images[..., _ALPHA]
        if len(flows) < len(images):
            plan, span, alphas = every_frame(len(flows)), 1.0, alphas[::every]
        vectors = motion_vectors(plan, flows, alphas, span=span, y="down")
        shown = decoded(to_8bit(vectors.coded).astype(np.float32) / 255.0, scale=vectors.scale, y="down")
    numbers, pictures = [], []
    for first in range(0, len(images) - every, every):
        for away in range(1, every):
            a, b, part = images[first], images[first + every], away / every
            if shown is not None:
                pair = shown[first // every], shown[first // every + 1]
                pictures.append(blend(a, b, *pair, part))
            else:
                pictures.append(a if method == "held" else (1.0 - part) * a + part * b)
            numbers.append(first + away)
    return numbers, pictures


def coded(image: Float[np.ndarray, "*n c"]) -> Float[np.ndarray, "*n c"]:
    """Maps through the sRGB curve, alpha as it is: what a screen is nearest to."""
    return np.clip(np.concatenate([encode_srgb(image[..., :6]), image[..., 6:]], axis=-1), 0.0, 1.0)


def studied(scene: str, maps: Path, measured: Measurement) -> tuple[dict[tuple[str, int], float], Image.Image]:
    """PSNR [dB] by method and step, and a strip of one frame by every method at the widest step."""
    files = sorted(maps.glob("frame_*.exr"))
    files = files[: (len(files) - 1) // STEPS[-1] * STEPS[-1] + 1]
    images = np.stack([read_exr(file, CHANNELS) for file in files])
    images[..., :_ALPHA] /= np.percentile(images[..., :_ALPHA], 99.9)
    wind = np.stack([read_exr(file, FLOW_CHANNELS) for file in files])
    estimated = estimated_flows(len(files), lambda number: images[number], CHANNELS)
    for name, flows in (("simulated", wind), ("estimated", estimated)):
        moved = np.linalg.norm(flows, axis=-1)[images[..., _ALPHA] > 0.1]
        measured.add(f"{scene}: {name} motion, 90th percentile", float(np.percentile(moved, 90)), "px/frame")
    results, row = {}, []
    shown = len(images) // 2 // STEPS[-1] * STEPS[-1] + STEPS[-1] // 2
    for every in STEPS:
        kept = images[::every]
        from_kept = estimated_flows(len(kept), lambda number, kept=kept: kept[number], CHANNELS)
        known = {"simulated": wind, "estimated": estimated, "from kept": from_kept}
        for method in METHODS:
            numbers, pictures = remade(images, every, method, known.get(method))
            errors = []
            for number, picture in zip(numbers, pictures, strict=True):
                seen = (images[number][..., _ALPHA] > _SEEN) | (picture[..., _ALPHA] > _SEEN)
                errors.append(mse(predicted=coded(picture), reference=coded(images[number]), mask=seen))
            results[method, every] = summarise_psnr(errors).psnr_of_mean_mse_db
            measured.add(f"{scene}: every {every}, {method}", results[method, every], "dB")
            if every == STEPS[-1]:
                row.append((method, pictures[numbers.index(shown)]))
        gain = results["estimated", every] - results["linear", every]
        # every 2nd frame of slow smoke is near 50 dB either way: there resampling costs more than vectors bring
        bound = 0.5 if every > STEPS[0] else None
        measured.add(f"{scene}: every {every}, estimated above linear", gain, "dB", at_least=bound)
    return results, strip(scene, [("bake", images[shown]), *row])


def strip(scene: str, pictures: list[tuple[str, np.ndarray]]) -> Image.Image:
    """One row: the right map of each picture."""
    size = pictures[0][1].shape[0]
    sheet = Image.new("RGB", (len(pictures) * size, size + 16), "white")
    draw = ImageDraw.Draw(sheet)
    for column, (name, picture) in enumerate(pictures):
        grey = to_8bit(encode_srgb(picture[..., DIRECTIONS.index("right")]))
        sheet.paste(Image.fromarray(grey), (column * size, 16))
        draw.text((column * size + 4, 2), f"{scene}: {name}", fill="black")
    return sheet


def page(results: dict[str, dict[tuple[str, int], float]]) -> str:
    """The table, one row a method and step."""
    lines = [
        "| kept | between two kept frames | " + " | ".join(scene.replace("_", " ") for scene in results) + " |",
        "|---" * (len(results) + 2) + "|",
    ]
    for every in STEPS:
        for method, says in METHODS.items():
            values = " | ".join(f"{found[method, every]:.1f}" for found in results.values())
            lines.append(f"| every {every} | {says} | {values} |")
    return "\n".join(lines)


def main() -> int:
    options = parser(__doc__.split("\n\n")[0])
    options.add_argument("--work", type=Path, default=ROOT / "runs/flipbooks", help="bakes of make_flipbooks.py")
    options.add_argument("--write", action="store_true", help="write docs/engines/motion_vectors.md and its picture")
    chosen = options.parse_args()
    recipes = [recipe for recipe in RECIPES if not chosen.quick or recipe.name == "smoke"]
    measured = Measurement(config={"scenes": [recipe.name for recipe in recipes], "steps": STEPS}, repetitions=1)
    results, strips = {}, []
    for recipe in recipes:
        results[recipe.name], picture = studied(recipe.name, baked(recipe, chosen.work), measured)
        strips.append(picture)
    sheet = Image.new("RGB", (strips[0].width, sum(one.height for one in strips)), "white")
    for row, one in enumerate(strips):
        sheet.paste(one, (0, row * one.height))
    write_8bit_png(PICTURE if chosen.write else chosen.work / "motion_vectors.png", np.asarray(sheet))
    if chosen.write:
        write_section(PAGE, "table", page(results))
    return measured.finish(chosen.json)


if __name__ == "__main__":
    sys.exit(main())
