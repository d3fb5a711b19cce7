"""Damage volume files of every format and read them: each must read or raise a clear VolumeError.

python scripts/fuzz_volumes.py --mutations 2000

Bytes are cut, flipped, overwritten with extreme numbers, or moved. A read that crashes, raises anything else, gives
a frame that is not finite, or takes too long or too much memory is a failure; exit 1 if there is one.
"""

import argparse
import multiprocessing
import resource
import struct
import sys
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from measurement import Measurement, parser

from sixway.core.frames import Grid
from sixway.core.records import DensityFrame
from sixway.volumes.limits import VolumeError
from sixway.volumes.read import READABLE, list_grids, read_volume
from sixway.volumes.write import WRITABLE, write_volume

ROOT = Path(__file__).parents[1]
LONGEST_S = 10.0
LARGEST_BYTES = 12 << 30  # address space of the reading process: the largest grid twice, and the libraries
_EXTREMES = (0, 1, 2, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)


def seeds(folder: Path) -> dict[str, list[Path]]:
    """Undamaged files by suffix: our own writers' and those that OpenVDB wrote."""
    rng = np.random.default_rng(5)
    density = rng.random((13, 10, 12), dtype=np.float32)
    density[:, :4] = 0.0
    frame = DensityFrame(density=density, grid=Grid.centred(density.shape))
    for suffix in WRITABLE:
        write_volume(folder / f"own{suffix}", frame)
    np.save(folder / "own.npy", density)
    numbers = " ".join(f"{value:.4g}" for value in density.ravel())
    (folder / "own.pbrt").write_text(
        'MakeNamedMedium "smoke" "string type" "uniformgrid" "integer nx" 12 "integer ny" [ 10 ] "integer nz" [13]\n'
        f'"point3 p0" [0 0 0] "point3 p1" [1.2 1.0 1.3] "float density" [ {numbers} ]\n'
    )
    plain = folder / "plain.nvdb"  # without zip, whose checksum would find most damage
    plain.write_bytes(unzipped_nvdb((folder / "own.nvdb").read_bytes()))
    found = {suffix: sorted(folder.glob(f"*{suffix}")) for suffix in READABLE}
    found[".vdb"] += sorted((ROOT / "tests/volumes/data").glob("*.vdb"))
    return found


def unzipped_nvdb(zipped: bytes) -> bytes:
    """The same one-grid NanoVDB file with codec none."""
    import zlib

    (name_bytes,) = struct.unpack_from("<I", zipped, 16 + 136)
    start = 16 + 176 + name_bytes
    head = bytearray(zipped[:start])
    struct.pack_into("<H", head, 14, 0)
    return bytes(head) + zlib.decompress(zipped[start + 8 :])


def damage(whole: bytes, rng: np.random.Generator) -> bytes:
    """One to four random wounds; headers are hit as often as the long rest."""
    data = bytearray(whole)
    for _ in range(rng.integers(1, 5)):
        if len(data) < 16:
            break
        reach = len(data) if rng.random() < 0.5 else min(len(data), 1024)
        at = int(rng.integers(reach))
        match rng.integers(6):
            case 0:
                del data[int(rng.integers(len(data))) :]
            case 1:
                data[at] ^= 1 << int(rng.integers(8))
            case 2:
                data[at] = int(rng.integers(256))
            case 3:
                extreme = int(rng.choice(np.array(_EXTREMES, np.uint64)))
                width = int(rng.choice((4, 8)))
                at = min(at // 4 * 4 + int(rng.integers(4)), len(data) - 8)
                data[at : at + width] = (extreme & (1 << 8 * width) - 1).to_bytes(width, "little")
            case 4:
                del data[at : at + int(rng.integers(1, 64))]
            case 5:
                other = int(rng.integers(len(data)))
                data[at:at] = data[other : other + int(rng.integers(1, 64))]
    return bytes(data)


def outcome(path: Path) -> str:
    """``read``, ``error``, or what went wrong."""
    started = time.perf_counter()
    try:
        list_grids(path)
    except VolumeError:
        pass
    except Exception as error:
        return f"list_grids: {type(error).__name__}: {error}"[:120]
    try:
        frame = read_volume(path)
        result = "read" if np.isfinite(frame.density).all() else "not finite"
    except VolumeError as error:
        result = "error" if path.name in str(error) else f"error names no file: {error}"[:120]
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:120]
    seconds = time.perf_counter() - started
    return result if seconds < LONGEST_S else f"took {seconds:.1f} s"


def fuzz(files: list[Path], first: int, mutations: int, channel: Connection) -> None:
    """In a process of its own: one outcome a mutation, so that a crash shows as silence."""
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_BYTES, LARGEST_BYTES))
    whole = [path.read_bytes() for path in files]
    with tempfile.TemporaryDirectory() as name:
        for number in range(first, mutations):
            path = Path(name) / f"damaged{files[0].suffix}"
            path.write_bytes(damage(whole[number % len(whole)], np.random.default_rng([9, number])))
            channel.send(outcome(path))
    channel.send("end")


def run_format(files: list[Path], mutations: int) -> tuple[Counter[str], float]:
    """Outcomes of all mutations and the longest silence [s]; after a crash a new process goes on behind it."""
    outcomes: Counter[str] = Counter()
    done, longest = 0, 0.0
    context = multiprocessing.get_context("spawn")
    while done < mutations:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=fuzz, args=(files, done, mutations, sender))
        process.start()
        sender.close()
        started = None  # the first outcome waits for imports
        while True:
            try:
                answer = receiver.recv() if receiver.poll(120.0) else "hang"
            except EOFError:
                answer = "crash"
            now = time.perf_counter()
            longest = max(longest, now - started) if started else longest
            started = now
            if answer == "end":
                break
            if answer not in ("read", "error"):
                print(f"{files[0].suffix} mutation {done}: {answer}", flush=True)
            outcomes[answer] += 1
            done += 1
            if answer in ("crash", "hang"):
                process.kill()
                break
        process.join()
    return outcomes, longest


def main() -> int:
    options: argparse.ArgumentParser = parser("Damage volume files and read them")
    options.add_argument("--mutations", type=int, default=2000, help="a format (default: 2000; --quick: 100)")
    options.add_argument("--format", choices=READABLE, action="append", help="only this one; may be repeated")
    chosen = options.parse_args()
    mutations = 100 if chosen.quick else chosen.mutations
    measurement = Measurement(config={"mutations": mutations, "limit_s": LONGEST_S}, repetitions=1)
    with tempfile.TemporaryDirectory() as name:
        for suffix, files in seeds(Path(name)).items():
            if chosen.format and suffix not in chosen.format:
                continue
            outcomes, longest = run_format(files, mutations)
            measurement.add(f"{suffix} reads", outcomes["read"], "files")
            measurement.add(f"{suffix} clear errors", outcomes["error"], "files")
            measurement.add(
                f"{suffix} anything else", mutations - outcomes["read"] - outcomes["error"], "files", at_most=0
            )
            measurement.add(f"{suffix} longest read", longest, "s", at_most=LONGEST_S)
    return measurement.finish(chosen.json)


if __name__ == "__main__":
    sys.exit(main())
