"""Make a dataset: `python -m sixway.generate configs/data/tiny.yaml --out runs/tiny_data`."""

import sys

from sixway.generation.command import main

__all__ = ["main"]

if __name__ == "__main__":
    sys.exit(main())
