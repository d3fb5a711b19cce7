"""Make a dataset: `python -m sixway.generate configs/data/tiny.yaml --out runs/tiny_data`."""

import sys
from collections.abc import Sequence

from sixway.extras.moments import make_flow
from sixway.generation import command


def main(
    arguments: Sequence[str] | None = None,
    *,
    only: Sequence[str] = command.STAGES,
    program: str | None = "python -m sixway.generate",
) -> int:
    """Make what is missing of a dataset, the stages `only` in order; the exit status. program: its name in the help."""
    return command.main(arguments, only=only, program=program, make_flow=make_flow)


if __name__ == "__main__":
    sys.exit(main())
