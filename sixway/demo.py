"""The whole pipeline on the embedded defaults: `make demo`, or `python -m sixway.demo --out demo`."""

import argparse
import json
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from sixway import evaluate, export, generate, relight, train

_CONFIGS = Path(__file__).parents[1] / "configs"
_NEEDED_OVER_MEAN_DB = 6.0

_KEY, _FILL = "right,1.0,0.92,0.8", "-0.3:1:0.4,0.15,0.22,0.35"
_REAL_VOLUMES = {"shadeops_teapot_cloud.nvdb": "y", "mitsuba_tutorial_volume.vol": "z"}
"""Volumes of other people, shown if SIXWAY_REAL_VOLUMES names their folder, with the axis that points up."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run every stage; 0 if the net beats the floors, 1 if it does not or a stage failed."""
    parser = argparse.ArgumentParser(
        prog="python -m sixway.demo",
        description="Simulate, guide, path-trace, train, evaluate, export, relight. The same command resumes.",
    )
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder for everything (default: demo)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (default: cpu)")
    options = parser.parse_args(arguments)
    out, device = options.out, ["--device", options.device]
    data, run, onnx = out / "dataset", out / "run", out / "sixway.onnx"
    if not _CONFIGS.is_dir():
        print(f"error: {_CONFIGS}: no configs here; run the demo from a checkout of the repository", file=sys.stderr)
        return 1

    stages: dict[str, Callable[[], int]] = {
        "simulate, march guides, trace references": lambda: generate.main(
            [str(_CONFIGS / "data/tiny.yaml"), "--out", str(data), *device]
        ),
        "train": lambda: train.main(
            [str(_CONFIGS / "train/tiny.yaml"), f"data={data}", "--run-dir", str(run), *device]
        ),
        "evaluate": lambda: evaluate.main([str(run), "--out", str(out / "report"), *device]),
        "export": lambda: export.main([str(run), "-o", str(onnx), "--size", "256"]),
        "relight": lambda: _relight_all(out, data, run, onnx, device),
    }
    seconds: dict[str, float] = {}
    for name, stage in stages.items():
        print(f"\n== {name}", flush=True)
        start = time.perf_counter()
        status = stage()
        seconds[name] = time.perf_counter() - start
        if status != 0:
            print(f"DEMO FAILED in stage {name!r} with status {status}; the message stands above", file=sys.stderr)
            return 1
    return _conclude(out, seconds)


def _relight_all(out: Path, data: Path, run: Path, onnx: Path, device: list[str]) -> int:
    """Our own smoke turning, by the run and by the ONNX file, and the volumes of other people."""
    smoke = sorted((data / "density").glob("cylinder_b/*/frame_*.npz"))[-1]
    lights = ["--light", _KEY, "--light", _FILL]
    jobs = [
        [str(smoke), "--checkpoint", str(run), *lights, "--camera-yaw", "0:90", "-o", str(out / "relit_turn.mp4")],
        [str(smoke), "--checkpoint", str(onnx), *lights, "--camera-yaw", "30", "-o", str(out / "relit_onnx.png")],
    ]
    folder = Path(os.environ.get("SIXWAY_REAL_VOLUMES") or "no real volumes")
    for name, up in _REAL_VOLUMES.items():
        if (folder / name).is_file():
            picture = out / f"relit_{Path(name).stem}.png"
            view = ["--up", up, "--camera-yaw", "30", "--size", "384"]
            jobs.append([str(folder / name), "--checkpoint", str(run), *lights, *view, "-o", str(picture)])
    if len(jobs) == 2:
        print("SIXWAY_REAL_VOLUMES names no folder with volumes of other people, so none is relit")
    # the exported net runs on the CPU: onnxruntime-gpu is no dependency
    return max(relight.main(job if str(onnx) in job else [*job, *device]) for job in jobs)


def _conclude(out: Path, seconds: dict[str, float]) -> int:
    report = json.loads((out / "report/report.json").read_text())
    psnr = {name: summary["psnr"]["maps"]["psnr_of_mean_mse_db"] for name, summary in report["methods"].items()}
    shutil.copyfile(out / "report/contact_sheet_1.png", out / "contact_sheet.png")
    print("\n== result")
    for name, value in psnr.items():
        print(f"{name:>16}: {value:6.2f} dB (six maps, sRGB, PSNR of the mean MSE, test simulation)")
    print(f"{'ceiling':>16}: {report['ceiling_psnr_db']:6.2f} dB (noise of the references)")
    for name, value in seconds.items():
        print(f"{value:6.0f} s  {name}")
    print(f"contact sheet: {out / 'contact_sheet.png'}")
    print(f"report:        {out / 'report/report.html'}")
    for picture in sorted([*out.glob("relit_*.png"), *out.glob("relit_*.mp4")]):
        print(f"relit:         {picture}")
    over_mean, over_fit = psnr["net"] - psnr["mean image"], psnr["net"] - psnr["linear fit"]
    if over_mean < _NEEDED_OVER_MEAN_DB or over_fit <= 0.0:
        print(
            f"DEMO FAILED: the net is {over_mean:.2f} dB over the mean image (needs {_NEEDED_OVER_MEAN_DB}) and "
            f"{over_fit:.2f} dB over the linear fit (needs more than 0)",
            file=sys.stderr,
        )
        return 1
    print(f"the net beats the mean image by {over_mean:.2f} dB and the linear fit by {over_fit:.2f} dB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
