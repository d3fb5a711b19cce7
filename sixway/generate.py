"""Make a dataset: `python -m sixway.generate configs/data/tiny.yaml --out runs/tiny_data`."""

import sys
from collections.abc import Sequence

from sixway.generation import command


def main(arguments: Sequence[str] | None = None) -> int:
    """Make what is missing of a dataset, all stages in order; the exit status."""
    return command.main(arguments, program="python -m sixway.generate")


if __name__ == "__main__":
    sys.exit(main())
