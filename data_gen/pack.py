"""Frames -> packed arrays and manifest.json."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None, only=("pack",)))
