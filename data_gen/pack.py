"""Frames -> packed arrays and manifest.json."""

import sys

from sixway.generation.command import main

if __name__ == "__main__":
    sys.exit(main(only=("pack",)))
