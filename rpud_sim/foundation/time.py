"""Time as integer nanoseconds, and its conversions."""

from __future__ import annotations

import sys

SECOND = 1_000_000_000  # ns

# Time that never comes [ns].
NEVER = sys.maxsize


def split_seconds(nanoseconds: int) -> tuple[int, int]:
    """Return whole seconds and the nanoseconds that remain, 0 to 999,999,999."""
    return divmod(nanoseconds, SECOND)


def split_fraction(nanoseconds: int) -> tuple[int, float]:
    """Return whole seconds and the fraction that remains, from 0 to 1 [s]."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return seconds, rest / SECOND


def join_seconds(seconds: int, nanoseconds: int) -> int:
    """Return whole seconds and nanoseconds as nanoseconds; the inverse of ``split_seconds``."""
    return seconds * SECOND + nanoseconds
