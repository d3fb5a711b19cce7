"""Density frames -> guide maps and image motion."""

import sys

from sixway.generation.command import main

if __name__ == "__main__":
    sys.exit(main(only=("march_guides",)))
