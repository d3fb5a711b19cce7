"""Density frames -> reference lightmaps."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None, only=("trace_references",)))
