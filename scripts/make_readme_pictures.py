"""Remake the README's pictures from a finished demo: docs/images/contact_sheet.png and relit.png.

python scripts/make_readme_pictures.py demo
"""

import shutil
import sys
from pathlib import Path

from PIL import Image

IMAGES = Path(__file__).parents[1] / "docs/images"
RELIT = ("relit_onnx.png", "relit_shadeops_teapot_cloud.png", "relit_mitsuba_tutorial_volume.png")
SIDE_PX = 384


def main() -> None:
    demo = Path(sys.argv[1] if len(sys.argv) > 1 else "demo")
    IMAGES.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(demo / "contact_sheet.png", IMAGES / "contact_sheet.png")
    strip = Image.new("RGB", (SIDE_PX * len(RELIT), SIDE_PX))
    for number, name in enumerate(RELIT):
        strip.paste(Image.open(demo / name).convert("RGB").resize((SIDE_PX, SIDE_PX)), (SIDE_PX * number, 0))
    strip.save(IMAGES / "relit.png")


if __name__ == "__main__":
    main()
