"""A trained net on volumes from elsewhere, against the path-traced truth of the same volume and view.

python scripts/validate_volumes.py RUN_DIR FOLDER --json volumes.json

These volumes are held out: nothing may be tuned to them. A row is missed where the net is worse than
the guide as it is.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
import warp as wp
from measurement import Measurement, parser

from sixway.core.color import encode_srgb
from sixway.core.config import parse_config
from sixway.core.conventions import DIRECTIONS
from sixway.core.frames import Camera
from sixway.core.png import to_8bit, write_8bit_png
from sixway.core.records import GuideMap, Medium, SixWayLightmap
from sixway.guide.march import GuideConfig, GuideMarcher
from sixway.inference.predict import load_predictor, predict
from sixway.metrics.psnr import psnr
from sixway.reference.lightmaps import LightmapTracer, ReferenceConfig
from sixway.volumes.extinction import extinction_for_optical_depth
from sixway.volumes.read import read_volume

VOLUMES = {"shadeops_teapot_cloud.nvdb": "y", "mitsuba_tutorial_volume.vol": "z"}
"""File names and the axis that points up in each."""


def main() -> int:
    options = parser((__doc__ or "").splitlines()[0])
    options.add_argument("run_dir", type=Path)
    options.add_argument("folder", type=Path, help="folder with the volumes")
    options.add_argument("--pictures", type=Path, help="write predicted and true maps side by side into this folder")
    chosen = options.parse_args()
    size, samples = (64, 2) if chosen.quick else (128, 8)
    wp.config.log_level = wp.LOG_WARNING
    predictor = load_predictor(chosen.run_dir, device="cpu")
    guide_config = parse_config(GuideConfig, predictor.card.guide, source="the net's guide")
    if not set(DIRECTIONS) <= set(guide_config.channels):
        raise SystemExit("error: this script compares with the guide's own six maps; train with guide=rich")
    result = Measurement({"run": str(chosen.run_dir), "size_px": size, "samples": samples, "bounces": "paper"}, 1)
    for name, up in VOLUMES.items():
        if not (chosen.folder / name).is_file():
            print(f"{chosen.folder / name}: not there, left out")
            continue
        frame = read_volume(chosen.folder / name, up="z" if up == "z" else "y")
        extinction = extinction_for_optical_depth(frame)
        medium = Medium(extinction_per_m=extinction)
        camera = Camera.around(frame.grid, yaw_deg=30.0, margin=0.8, width_px=size, height_px=size)
        start = time.perf_counter()
        guide = GuideMarcher(guide_config, medium, device="cpu", threads=os.cpu_count() or 1).march(
            frame, camera, seed=0
        )
        predicted = predict(predictor, guide)
        baked = time.perf_counter()
        tracer = LightmapTracer(ReferenceConfig(samples=samples), medium, device="cpu")
        truth = tracer.trace(frame, camera, seed=1)
        traced = time.perf_counter()

        def encoded(shown: SixWayLightmap | GuideMap) -> np.ndarray:
            maps = np.stack([shown[direction] for direction in DIRECTIONS], axis=-1)
            return encode_srgb(maps * np.float32(predictor.card.scale)).astype(np.float32)

        floor = psnr(predicted=encoded(guide), reference=encoded(truth))
        result.add(f"{name}: guide as it is, six maps in sRGB", floor, "dB")
        net = psnr(predicted=encoded(predicted), reference=encoded(truth))
        result.add(f"{name}: net, six maps in sRGB", net, "dB", at_least=floor)
        mask = truth["alpha"] > 0.02
        inside = psnr(predicted=encoded(predicted), reference=encoded(truth), mask=mask)
        result.add(f"{name}: net, foreground alone", inside, "dB")
        result.add(f"{name}: guide and net", baked - start, "s")
        result.add(f"{name}: reference", traced - baked, "s")
        if chosen.pictures:
            rows = [np.concatenate(list(np.moveaxis(encoded(m), -1, 0)), axis=1) for m in (predicted, truth)]
            write_8bit_png(chosen.pictures / f"{Path(name).stem}.png", to_8bit(np.concatenate(rows)[..., None]))
    return result.finish(chosen.json)


if __name__ == "__main__":
    sys.exit(main())
