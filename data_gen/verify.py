"""Check every hash and every pixel of a dataset."""

import sys

from sixway.generation.command import main

if __name__ == "__main__":
    sys.exit(main(only=("verify",)))
