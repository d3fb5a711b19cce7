"""What can this machine do? `python -m sixway.doctor`."""

import argparse
import os
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sixway.core.store import provenance


def main(arguments: Sequence[str] | None = None) -> int:
    """Print devices, frameworks, caches and remedies; 1 if something that every user needs is missing."""
    argparse.ArgumentParser(
        prog="python -m sixway.doctor", description="Say what this machine can do, and the remedy for what is missing."
    ).parse_args(arguments)
    table = Table("what", "found", "remedy", title="sixway doctor", show_lines=False)
    checks = [_platform(), _torch(), _warp(), _mitsuba(), _onnxruntime(), _ffmpeg(), *_caches()]
    for what, found, remedy in checks:
        table.add_row(what, found, remedy)
    Console(width=None if sys.stdout.isatty() else 160).print(table)
    return 1 if any(remedy.startswith("needed:") for _, _, remedy in checks) else 0


Check = tuple[str, str, str]
"""What was looked at, what was found, and the remedy ("" if all is well)."""


def _platform() -> Check:
    made = provenance()
    return "sixway", f"{made['sixway']} ({made['commit']}), Python {made['python']}, {made['hardware']}", ""


def _torch() -> Check:
    import torch

    if torch.cuda.is_available():
        return "torch", f"{torch.__version__}, {torch.cuda.get_device_name(0)}", ""
    return "torch", f"{torch.__version__}, CPU only", "for a GPU: install torch with CUDA; use --device cuda"


def _warp() -> Check:
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    wp.init()
    devices = ", ".join(str(device) for device in wp.get_devices())
    remedy = "" if wp.is_cuda_available() else "for a GPU: an NVIDIA driver; use --device cuda"
    return "warp", f"{wp.config.version}: {devices}", remedy


def _mitsuba() -> Check:
    from sixway.reference.variant import describe, use_variant

    try:
        variant = use_variant("auto")
    except ImportError as error:
        return "mitsuba", f"does not start: {error}", "needed: pip install mitsuba"
    made = provenance()
    found = f"mitsuba {made['mitsuba']}, drjit {made['drjit']}, {variant}; {describe()['llvm']}"
    remedy = "pip install karellen-llvm-core: LLVM makes references many times faster" if "scalar" in variant else ""
    return "mitsuba", found, remedy


def _onnxruntime() -> Check:
    import onnxruntime

    providers = ", ".join(onnxruntime.get_available_providers())
    remedy = "" if "CUDA" in providers else "for a GPU: pip install onnxruntime-gpu instead of onnxruntime"
    return "onnxruntime", f"{onnxruntime.__version__}: {providers}", remedy


def _ffmpeg() -> Check:
    import imageio_ffmpeg

    try:
        return "ffmpeg", imageio_ffmpeg.get_ffmpeg_exe(), ""
    except RuntimeError as error:
        return "ffmpeg", f"not found: {error}", "for .mp4 output: pip install imageio-ffmpeg"


def _caches() -> list[Check]:
    import warp as wp

    folders = {
        "warp kernels": Path(wp.config.kernel_cache_dir or Path.home() / ".cache/warp"),
        "drjit kernels": Path.home() / ".drjit",
        "working folder": Path.cwd(),
    }
    checks = []
    for what, folder in folders.items():
        existing = folder
        while not existing.exists():
            existing = existing.parent
        free = shutil.disk_usage(existing).free / 1e9
        writable = os.access(existing, os.W_OK)
        remedy = "" if writable else "needed: make it writable" + (", or set WARP_CACHE_PATH" if "warp" in what else "")
        checks.append((what, f"{folder}, {free:.0f} GB free", remedy))
    return checks


if __name__ == "__main__":
    sys.exit(main())
