"""How a command ends: with its status, or with one line that says what was wrong."""

import sys
from collections.abc import Callable


def status_of(work: Callable[[], int]) -> int:
    """What `work` returns; 2, and its message on standard error, for an error that a user can mend."""
    try:
        return work()
    except (ValueError, OSError, RuntimeError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
