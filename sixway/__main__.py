"""`sixway NAME ...`, or `python -m sixway NAME ...`: the same as `python -m sixway.NAME ...`."""

import importlib
import sys
from collections.abc import Sequence

COMMANDS = {
    "for artists and engine programmers": {
        "relight": "light any volume with suns, lamps and skies: a picture, a video or a folder",
        "bake": "path-trace the six maps of volumes, one EXR a frame",
        "pack": "maps to flipbooks and texture arrays of engines",
        "unpack": "textures of engines back to maps",
    },
    "for researchers": {
        "simulate": "a scenario to a sequence of smoke volumes",
        "generate": "a dataset: simulate, march guides, trace references, pack, verify",
        "train": "train a net on a dataset",
        "evaluate": "score a net beside what needs none",
        "export": "a trained net as ONNX files",
        "train_flow": "train the flow estimator of the flow loss",
    },
    "for everybody": {
        "demo": "the whole pipeline on small defaults, in minutes",
        "doctor": "what can this machine do?",
    },
}
"""Every command with a line about it, by who needs it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the first argument names; its exit status."""
    name, *rest = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if name in ("-h", "--help"):
        print(_help())
        return 0
    known = [command for group in COMMANDS.values() for command in group]
    if name not in known:
        print(f"error: there is no command {name!r}; use one of {', '.join(known)}", file=sys.stderr)
        return 2
    try:
        command = importlib.import_module(f"sixway.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == "sixway":
            raise
        print(f"error: sixway {name} needs the package {error.name}; run: pip install sixway", file=sys.stderr)
        return 2
    status: int = command.main(rest)
    return status


def _help() -> str:
    lines = ["usage: sixway COMMAND ...; sixway COMMAND --help tells its options"]
    for audience, commands in COMMANDS.items():
        lines += ["", f"{audience}:", *(f"  {name:<11} {about}" for name, about in commands.items())]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
