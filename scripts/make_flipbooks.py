"""Four flipbooks that engines can use as they are: simulate, bake, pack into assets/flipbooks, all our own.

python scripts/make_flipbooks.py [--only smoke] [--quick --out toy]

`--work` keeps volumes and baked frames: the same command goes on where it stopped. `--quick` makes toys of 4 frames.

Hardware and time: 2 CPU cores, about 15 min on a quiet machine. Size: at most 10 MB, or it fails.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from sixway.bake import main as bake
from sixway.core.command import status_of
from sixway.core.conventions import LIGHTMAP_CHANNELS
from sixway.core.png import write_png
from sixway.core.records import SixWayLightmap
from sixway.core.store import write_text
from sixway.engines.book import read_book
from sixway.engines.sidecar import read_sidecar
from sixway.pack import main as pack
from sixway.shading.compose import over, shade
from sixway.shading.light import DirectionalLight
from sixway.simulate import main as simulate

ROOT = Path(__file__).parents[1]
BOOKS = ROOT / "assets/flipbooks"
LARGEST_BYTES = 10_000_000
PREVIEW = "preview.png"
TILE_PX, SAMPLES = 128, 4


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """One flipbook. fps: of the simulation. loop: frames that fade into the first ones, None for a book that ends."""

    name: str
    says: str
    fps: float
    loop: int | None
    bake: tuple[str, ...]


RECIPES = (
    Recipe(name="smoke", says="dark column of a fire out of sight", fps=20.0, loop=12, bake=("--optical-depth", "10")),
    Recipe(
        name="explosion", says="six charges, with fire in LBFE.a", fps=60.0, loop=None, bake=("--optical-depth", "12")
    ),
    Recipe(name="steam", says="thin jet from a pipe", fps=30.0, loop=12, bake=("--optical-depth", "3")),
    Recipe(name="cloud_puff", says="a puff that rolls and fades", fps=25.0, loop=None, bake=("--optical-depth", "6")),
)

LICENCE = """CC0 1.0 Universal

The flipbooks of this folder (the .png and .json files) and the scenarios that they were made from are our own: they
were simulated, path-traced and packed by this project from no material of others. To the extent possible under law,
the authors of sixway have waived all copyright and related or neighbouring rights to them. You may copy, change and
use them, for money too, without asking and without naming anyone.

The whole text: https://creativecommons.org/publicdomain/zero/1.0/legalcode
"""


def baked(recipe: Recipe, work: Path, *, quick: bool = False) -> Path:
    """The folder of a book's frames, made where they are missing, with the simulator's motion in their layers."""
    volumes, maps = work / recipe.name / "volumes", work / recipe.name / "maps"
    few = "frames=5 warmup_frames=8" if recipe.loop else "frames=4 frames_per_second=8"
    toy = ["resolution={cells: 24, refinement: 2}", *few.split()]
    settings = [part for value in toy for part in ("--set", value)] if quick else []
    scenario = str(BOOKS / f"scenarios/{recipe.name}.yaml")
    _run(simulate([scenario, "--out", str(volumes), "--threads", "1", "--no-strip", *settings]), recipe)
    size, samples = (32, 1) if quick else (TILE_PX, SAMPLES)
    look = [*recipe.bake, "--motion", "--margin", "0.7", "--resolution", str(size), "--samples", str(samples)]
    _run(bake([str(volumes / "frame_*.npz"), "--out", str(maps), *look]), recipe)
    return maps


def packed(recipe: Recipe, maps: Path, out: Path, *, quick: bool = False) -> None:
    """Textures and sidecar of a book in `out`."""
    style = "--packing unity --grid auto --format png --motion estimate --brightness auto --emissive-brightness auto"
    closed = ["--loop", str(1 if quick else recipe.loop)] if recipe.loop else []
    borders = ["--fix-borders", "2" if quick else "4"]
    arguments = [str(maps), "--out", str(out / recipe.name), *style.split(), "--fps", str(recipe.fps)]
    _run(pack([*arguments, *closed, *borders]), recipe)


def _run(status: int, recipe: Recipe) -> None:
    if status:
        raise RuntimeError(f"{recipe.name}: the command above failed; mend it and run this script again")


def lit(path: Path, count: int = 8) -> Float[np.ndarray, "h w 3"]:
    """A row of a book's frames from the first to the last, in the sun from the upper right and their own fire."""
    book = read_book(path)
    frames = book.frames[..., [book.channels.index(name) for name in LIGHTMAP_CHANNELS]]
    shown = frames[np.linspace(0, len(frames) - 1, count).round().astype(int)]
    strength = book.sidecar.brightness
    sun = DirectionalLight(to_light=(0.6, 0.64, 0.48), colour=(strength, strength, strength))
    row = []
    for image in shown:
        lightmap = SixWayLightmap(channels=LIGHTMAP_CHANNELS, image=np.ascontiguousarray(image))
        smoke = shade(lightmap, [sun])
        row.append(over(smoke, lightmap["alpha"], np.full_like(smoke, 0.03)))
    return np.concatenate(row, axis=1)


def readme(out: Path) -> str:
    """What a user must know, from the sidecars; and the size of all, which must not exceed the limit."""
    lines = [
        "# Flipbooks to use",
        "",
        "Six-way lightmaps in the packing `unity`: `NAME_RTBA.png`, `NAME_LBFE.png` (R, G, B sRGB, A linear), motion",
        "vectors in `NAME_MV.png` (linear: sRGB off), and `NAME.json`, which says all else. Maps are premultiplied.",
        "Divide lights by `brightness`, fire by `emissive brightness`. Shaders: `sixway/engines/shaders`, how to use",
        "them: `docs/engines/blender_houdini_to_engines.md`. Licence: CC0, see LICENSE. Made by",
        "`scripts/make_flipbooks.py`.",
        "",
        f"![each of them in the sun from the upper right]({PREVIEW})",
        "",
        "| book | what | grid | frames | fps | loops | brightness | emissive brightness | motion scale | MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    total = 0
    for recipe in RECIPES:
        path = out / f"{recipe.name}.json"
        if not path.is_file():
            continue
        book = read_sidecar(path)
        held = sum((out / file.name).stat().st_size for file in book.files)
        total += held
        assert book.grid and book.motion  # every recipe asks for both
        lines.append(
            f"| {recipe.name} | {recipe.says} | {book.grid.columns}x{book.grid.rows} | {book.frames} | {book.fps:g} | "
            f"{'yes' if book.loop else 'no'} | {book.brightness:.3g} | {book.emissive_brightness:.3g} | "
            f"{book.motion.scale:.3g}, y {book.motion.y} | {held / 1e6:.2f} |"
        )
    if total > LARGEST_BYTES:
        raise ValueError(f"{out}: {total / 1e6:.1f} MB of textures; the limit is {LARGEST_BYTES / 1e6:g}: fewer frames")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--work", type=Path, default=ROOT / "runs/flipbooks", help="volumes and baked frames")
    parser.add_argument("--out", type=Path, default=BOOKS, help="where the textures go")
    parser.add_argument("--only", choices=[recipe.name for recipe in RECIPES], help="one of them")
    parser.add_argument("--quick", action="store_true", help="toys of 4 frames, under a minute; give --out as well")
    options = parser.parse_args()
    return status_of(lambda: run(options))


def run(options: argparse.Namespace) -> int:
    if options.quick and options.out == BOOKS:
        raise ValueError("--quick makes toys; give --out, so that they do not replace the real ones")
    work = options.work / "quick" if options.quick else options.work
    for recipe in RECIPES:
        if options.only in (None, recipe.name):
            packed(recipe, baked(recipe, work, quick=options.quick), options.out, quick=options.quick)
    write_text(options.out / "LICENSE", LICENCE)
    write_text(options.out / "README.md", readme(options.out))
    books = [options.out / f"{recipe.name}.json" for recipe in RECIPES]
    write_png(options.out / PREVIEW, np.concatenate([lit(path) for path in books if path.is_file()]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
