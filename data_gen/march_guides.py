"""Density frames -> guide maps and image motion."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None, only=("march_guides",)))
