"""Make a whole dataset: every stage in order."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None))
