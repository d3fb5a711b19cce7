"""Files that are whole or absent: atomic writes, hashes, provenance, and logs that survive a kill."""

import errno
import hashlib
import json
import os
import platform
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any, BinaryIO

_BLOCK = 4096
"""Bytes that common file systems keep together."""
_ZEROS = bytes(_BLOCK)


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it becomes `path` only if the block succeeds.

    The temporary name keeps the suffix, for writers that choose a format by it. Raises OSError naming
    the file and the remedy when the disk is full; nothing is left behind on any error.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".part-", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o666 & ~_umask())
        os.replace(temporary, path)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise OSError(
                error.errno, f"the disk is full; free space and run the same command again to resume: {path}"
            ) from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


@cache
def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_with_holes(file: BinaryIO, data: bytes) -> None:
    """Write `data`, skipping whole blocks of the file that are zero: holes read as zeros and take no disk.

    After the last call the writer must `truncate` the file to its position, or a hole at the end is lost.
    """
    position = file.tell()
    for start in range(-(position % _BLOCK), len(data), _BLOCK):
        block = data[max(start, 0) : start + _BLOCK]
        if len(block) == _BLOCK and block == _ZEROS:
            file.seek(_BLOCK, os.SEEK_CUR)
        else:
            file.write(block)


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, value: Any) -> None:
    """Write plain values as indented JSON, atomically; NaN is refused (ValueError)."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read JSON; raises ValueError that names the file if it is not."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not valid JSON ({error}); restore it or remake it") from error


def claim_folder(
    folder: Path, files: list[Path], *, record: str, settings: Mapping[str, Any], patterns: Sequence[str], replace: bool
) -> list[Path]:
    """Make `folder` hold the numbered `files` of one command and return those that are missing.

    settings: plain values of all that shapes the files, kept in `record`; the same command finds its files again.
    Raises ValueError that names what differs if the folder holds files of other settings (any that match `patterns`
    beside another record, or without a record those in the way), unless `replace`: then these are deleted first, since
    a kill in between must not pass them off as this command's.
    """
    path, plain = folder / record, json.loads(json.dumps(settings, allow_nan=False))
    held = read_json(path) if path.is_file() else None
    if held is None or held.get("settings") != plain:
        stale = files if held is None else [file for pattern in patterns for file in sorted(folder.glob(pattern))]
        stale = [file for file in stale if file.is_file()]
        if stale and not replace:
            raise ValueError(
                f"{folder}: holds {len(stale)} file(s), such as {stale[0].name}, {_origin(held, plain)}; name another "
                "folder, or delete and remake them by adding --replace to the same command"
            )
        for file in stale:
            file.unlink()
        write_json(path, {"settings": plain})
    return [file for file in files if not file.is_file()]


def _origin(held: Any, settings: Mapping[str, Any]) -> str:
    """How files in a folder differ from what is asked for."""
    if held is None:
        return "that this command did not make"
    if "settings" not in held:
        return "made by an earlier version, which kept no settings to compare"
    return f"made with other settings ({'; '.join(differences(held['settings'], settings))})"


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Where two trees of plain values differ, as ``a.b: 1 there, 2 here``; `old` is what is there."""
    there, here = _flat(old), _flat(new)
    return [
        f"{key}: {there.get(key, 'nothing')} there, {here.get(key, 'nothing')} here"
        for key in {**there, **here}
        if there.get(key) != here.get(key)
    ]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """``{"a": {"b": 1}}`` as ``{"a.b": 1}``."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {f"{prefix}{key}": value}
    return flat


def append_json_line(path: Path, value: Any) -> int:
    """Append one JSON line in a single write, so that writers in several processes do not mix lines; its bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    line = (json.dumps(value, allow_nan=False) + "\n").encode()
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    try:
        if os.lseek(handle, 0, os.SEEK_END) and not _ends_with_newline(path):
            line = b"\n" + line  # a killed writer may have left half a line
        return os.write(handle, line)
    finally:
        os.close(handle)


def _ends_with_newline(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def read_json_lines(path: Path) -> list[Any]:
    """Every whole line of a JSON-lines file; half a line left by a kill is skipped. [] if no file."""
    if not path.exists():
        return []
    values = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            values.append(json.loads(line))
        except json.JSONDecodeError:
            continue  # the unit behind a torn line is made again
    return values


def sha256_file(path: Path) -> str:
    """Hex SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_hash(value: Any) -> str:
    """Twelve hex digits that name plain values: equal for equal content, whatever the key order."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def inside(folder: Path, name: str) -> Path:
    """`folder / name`, refused (ValueError) if it would leave the folder."""
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"{name!r} points outside {folder}; a file list may only name files below it")
    return path


@cache
def provenance() -> dict[str, str]:
    """Who made a file: commit (``-dirty`` if the tree had changes), versions and hardware."""
    packages = ("sixway", "numpy", "torch", "warp-lang", "mitsuba", "drjit", "onnxruntime")
    return {
        "commit": _commit(),
        "python": platform.python_version(),
        "hardware": f"{_processor()}, {os.cpu_count()} cores",
        **{name: _version(name) for name in packages},
    }


def _commit() -> str:
    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(Path(__file__).parent), *arguments],
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        ).stdout.strip()

    try:
        revision = git("rev-parse", "--short=12", "HEAD")
        return revision + ("-dirty" if git("status", "--porcelain", "-uno") else "")
    except (OSError, subprocess.SubprocessError):
        return "unknown"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        return platform.processor() or platform.machine()
    return platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
