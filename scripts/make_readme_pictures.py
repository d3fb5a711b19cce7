"""Remake the pictures of the README and the documents.

python scripts/make_readme_pictures.py demo            # from a finished demo: contact_sheet.png and relit.png
python scripts/make_readme_pictures.py --bakes DIR     # from real volumes in DIR: bake_*.png
"""

import argparse
import shutil
import tempfile
from pathlib import Path

from PIL import Image

from sixway.bake import SHEET
from sixway.bake import main as bake

IMAGES = Path(__file__).parents[1] / "docs/images"
RELIT = ("relit_onnx.png", "relit_shadeops_teapot_cloud.png", "relit_mitsuba_tutorial_volume.png")
SIDE_PX = 384
BAKES = {
    "bake_teapot.png": ("shadeops_teapot_cloud.nvdb", "--margin", "0.7", "--bounces", "multi"),
    "bake_steam.png": ("mitsuba_tutorial_volume.vol", "--up", "z", "--margin", "0.7", "--bounces", "multi"),
    "bake_fire.png": ("mantaflow_fire/*.vdb", "--frames", "0:4", "--up", "z", "--margin", "0.8", "--self-lit"),
}
"""Volume and options of each bake. Sources and licences of the volumes: see README."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Remake the pictures of the README and the documents.")
    parser.add_argument("demo", type=Path, nargs="?", default=Path("demo"), help="folder of a finished demo")
    parser.add_argument("--bakes", type=Path, metavar="DIR", help="bake the volumes of DIR instead")
    options = parser.parse_args()
    IMAGES.mkdir(parents=True, exist_ok=True)
    if options.bakes:
        write_bakes(options.bakes)
    else:
        write_demo(options.demo)


def write_demo(demo: Path) -> None:
    shutil.copyfile(demo / "contact_sheet.png", IMAGES / "contact_sheet.png")
    strip = Image.new("RGB", (SIDE_PX * len(RELIT), SIDE_PX))
    for number, name in enumerate(RELIT):
        strip.paste(Image.open(demo / name).convert("RGB").resize((SIDE_PX, SIDE_PX)), (SIDE_PX * number, 0))
    strip.save(IMAGES / "relit.png")


def write_bakes(volumes: Path) -> None:
    for name, (volume, *more) in BAKES.items():
        with tempfile.TemporaryDirectory() as folder:
            if bake([str(volumes / volume), "--out", folder, "--resolution", "192", *more]):
                raise SystemExit(f"{name}: the bake failed")
            shutil.copyfile(Path(folder) / SHEET, IMAGES / name)


if __name__ == "__main__":
    main()
