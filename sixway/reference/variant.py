"""Which Mitsuba runs: CUDA, LLVM on the CPU, or scalar code where there is neither.

Dr.Jit loads LLVM as soon as it is IMPORTED, and its own search takes whatever the system has. LLVM 15
and 16 then abort the whole process on AVX-512 machines ("Cannot select: f32 = fminimum"). So this file
names a library first and imports drjit and mitsuba after that; no other file of this room may be
imported before `use_variant` has run, which `LightmapTracer` sees to.
"""

import ctypes
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Literal

Device = Literal["auto", "cpu", "cuda"]

_OLDEST_LLVM = 17
_REMEDY = "`pip install karellen-llvm-core`, or set DRJIT_LIBLLVM_PATH to libLLVM 17 or newer"


def use_variant(device: Device = "auto") -> str:
    """Make Mitsuba ready for `device` and return the variant; calling it again changes nothing.

    auto: CUDA if there is a device, else the CPU. cpu: LLVM, or without a usable LLVM ``scalar_rgb``,
    said once in one line on stderr. Raises ValueError for cuda where there is none.
    """
    variant = _choose(device)
    import mitsuba as mi

    if mi.variant() != variant:
        mi.set_variant(variant)
    return variant


def describe() -> dict[str, str]:
    """What a doctor prints: the active Mitsuba variant and the LLVM in use, or why there is none."""
    path, problem = _find_llvm()
    mitsuba = sys.modules.get("mitsuba")
    return {
        "variant": (mitsuba.variant() if mitsuba else None) or "not set yet",
        "llvm": f"{path} (LLVM {'.'.join(map(str, _llvm_version(path)))})" if path else f"{problem}; {_REMEDY}",
    }


@cache
def _choose(device: Device) -> str:
    path, problem = _find_llvm()
    if path:
        os.environ["DRJIT_LIBLLVM_PATH"] = str(path)
        import drjit as dr
    else:
        with _stderr_silenced():  # Dr.Jit would complain in lines of its own
            import drjit as dr
    if device != "cpu" and dr.has_backend(dr.JitBackend.CUDA):
        return "cuda_ad_mono"
    if device == "cuda":
        raise ValueError("device 'cuda' is not available to Dr.Jit; check the NVIDIA driver or use device 'cpu'")
    if path and dr.has_backend(dr.JitBackend.LLVM):
        loaded = dr.detail.llvm_version()
        if loaded[0] >= _OLDEST_LLVM:
            return "llvm_ad_mono"
        problem = f"drjit was imported before use_variant ran and took LLVM {loaded[0]}"
    print(
        f"sixway: slow scalar reference renderer, because {problem or 'LLVM did not start'}; {_REMEDY}", file=sys.stderr
    )
    return "scalar_rgb"


@cache
def _find_llvm() -> tuple[Path | None, str]:
    """The LLVM library for Dr.Jit, or None and why not. An explicit DRJIT_LIBLLVM_PATH is never replaced."""
    explicit = os.environ.get("DRJIT_LIBLLVM_PATH")
    wheel = _wheel_libraries()  # in any case: a parent process may have named the wheel's library explicitly
    candidates = [Path(explicit)] if explicit else [*wheel, *_system_libraries()]
    problem = "no libLLVM was found"
    for path in candidates:
        try:
            version = _llvm_version(path)
        except OSError as error:
            problem = f"{path} does not load ({error})"
            continue
        if version[0] >= _OLDEST_LLVM:
            return path, ""
        problem = f"{path} is older than LLVM {_OLDEST_LLVM}"
    return None, problem


def _wheel_libraries() -> list[Path]:
    """libLLVM of the karellen-llvm-core wheel, its C++ runtime loaded first.

    The wheel's library asks for libc++ by SONAME on no path that the linker knows; a copy that is
    already in the process satisfies it.
    """
    lib = Path(sys.prefix) / "lib"
    libraries = _newest_first(lib.glob("libLLVM.so.*"))
    if libraries:
        for name in ("libunwind.so.1", "libc++abi.so.1", "libc++.so.1"):
            for runtime in sorted(lib.glob(f"*-linux-gnu/{name}*"))[:1]:
                with suppress(OSError):  # libLLVM itself will name what is missing
                    ctypes.CDLL(str(runtime))
    return libraries


def _system_libraries() -> list[Path]:
    found = [*Path("/usr/lib").glob("*-linux-gnu/libLLVM*.so*"), *Path("/usr/lib").glob("llvm-*/lib/libLLVM*.so*")]
    found += [*Path("/usr/lib64").glob("libLLVM*.so*"), *Path("/opt/homebrew/opt/llvm/lib").glob("libLLVM.dylib")]
    return _newest_first(found)


def _newest_first(paths: Iterable[Path]) -> list[Path]:
    def version(path: Path) -> list[int]:
        return [int(digits) for digits in path.name.replace("-", ".").split(".") if digits.isdigit()]

    return sorted(paths, key=version, reverse=True)


def _llvm_version(path: Path) -> tuple[int, int, int]:
    """(0, 0, 0) for anything before LLVM 16, which could not tell. Raises OSError if it does not load."""
    library = ctypes.CDLL(str(path))
    if not hasattr(library, "LLVMGetVersion"):
        return 0, 0, 0
    numbers = [ctypes.c_uint() for _ in range(3)]
    library.LLVMGetVersion(*map(ctypes.byref, numbers))
    major, minor, patch = (number.value for number in numbers)
    return major, minor, patch


@contextmanager
def _stderr_silenced() -> Iterator[None]:
    """Drop what native code writes to stderr while the block runs."""
    sys.stderr.flush()
    kept = os.dup(2)
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(sink)
        os.close(kept)
