"""Check every hash and every pixel of a dataset."""

import sys

from sixway.generate import main

if __name__ == "__main__":
    sys.exit(main(program=None, only=("verify",)))
