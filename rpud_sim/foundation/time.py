"""Time as integer nanoseconds, and its conversions."""

from __future__ import annotations

import sys

SECOND = 1_000_000_000  # ns

# Time that never comes [ns].
NEVER = sys.maxsize


def split_fraction(nanoseconds: int) -> tuple[int, float]:
    """Return whole seconds and the fraction that remains, from 0 to 1 [s]."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return seconds, rest / SECOND


def join_seconds(seconds: int, nanoseconds: int) -> int:
    """Return whole seconds and nanoseconds as nanoseconds."""
    return seconds * SECOND + nanoseconds
