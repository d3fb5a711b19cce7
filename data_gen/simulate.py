"""Scenario -> density frames."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None, only=("simulate",)))
