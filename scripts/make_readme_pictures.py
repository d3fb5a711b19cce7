"""Remake the pictures of the README and the documents.

python scripts/make_readme_pictures.py --relit DIR     # relit.png: the shipped net on our jet and on volumes in DIR
python scripts/make_readme_pictures.py --sheet RUN     # contact_sheet.png: the worst frame of an evaluated run
python scripts/make_readme_pictures.py --bakes DIR     # bake_*.png: path-traced maps of volumes in DIR
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from PIL import Image

from sixway.bake import SHEET
from sixway.bake import main as bake
from sixway.relight import main as relight

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs/images"
SIDE_PX = 320
RELIT = {
    "tests/data/jet.npz": ("--margin", "0.75"),
    "shadeops_teapot_cloud.nvdb": ("--margin", "0.75"),
    "mitsuba_tutorial_volume.vol": ("--up", "z", "--margin", "0.65"),
    "mantaflow_fire/fluid_data_0032.vdb": ("--up", "z", "--margin", "0.85"),
}
"""Volume, ours or of the folder given, and options of each picture."""
LIGHTS = (
    ("--light", "1:0.6:0.3,1,0.85,0.6", "--light", "-1:0.2:-0.5,0.15,0.25,0.5"),
    ("--light", "-0.5:0.5:-1,1.2,1.1,1", "--light", "bottom,0.7,0.12,0.05"),
)
BAKES = {
    "bake_teapot.png": ("shadeops_teapot_cloud.nvdb", "--margin", "0.7", "--bounces", "multi"),
    "bake_steam.png": ("mitsuba_tutorial_volume.vol", "--up", "z", "--margin", "0.7", "--bounces", "multi"),
    "bake_fire.png": ("mantaflow_fire/*.vdb", "--frames", "0:4", "--up", "z", "--margin", "0.8", "--self-lit"),
}
"""Volume and options of each bake. Sources and licences of the volumes: see README."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Remake the pictures of the README and the documents.")
    parser.add_argument("--relit", type=Path, metavar="DIR", help="folder of real volumes")
    parser.add_argument("--sheet", type=Path, metavar="RUN", help="folder of an evaluated run")
    parser.add_argument("--bakes", type=Path, metavar="DIR", help="folder of real volumes")
    options = parser.parse_args()
    if options.relit:
        write_relit(options.relit)
    if options.sheet:
        shutil.copyfile(options.sheet / "report_test/contact_sheet_0.png", IMAGES / "contact_sheet.png")
    if options.bakes:
        write_bakes(options.bakes)


def write_relit(volumes: Path) -> None:
    """A column a volume, a row a pair of lights, by the net that relight takes by default."""
    strip = Image.new("RGB", (SIDE_PX * len(RELIT), SIDE_PX * len(LIGHTS)))
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.png"
        for column, (name, more) in enumerate(RELIT.items()):
            volume = ROOT / name if (ROOT / name).is_file() else volumes / name
            for row, lights in enumerate(LIGHTS):
                if relight([str(volume), *more, *lights, "--size", str(SIDE_PX), "-o", str(picture)]):
                    raise SystemExit(f"{name}: could not be relit")
                strip.paste(Image.open(picture).convert("RGB"), (SIDE_PX * column, SIDE_PX * row))
    strip.save(IMAGES / "relit.png")


def write_bakes(volumes: Path) -> None:
    for name, (volume, *more) in BAKES.items():
        with tempfile.TemporaryDirectory() as folder:
            if bake([str(volumes / volume), "--out", folder, "--resolution", "192", *more]):
                raise SystemExit(f"{name}: the bake failed")
            shutil.copyfile(Path(folder) / SHEET, IMAGES / name)


if __name__ == "__main__":
    main()
