"""Text on a terminal: errors in one line, and no name from outside that steers the terminal."""

from __future__ import annotations

import re
import sys

# What moves a cursor, changes the direction of writing, or has no encoding.
_STEERING = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: object) -> str:
    r"""Return a text with escapes such as ``\x1b`` for what a terminal would obey."""
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))


def complain(program: str, reason: object) -> None:
    """Print an error on standard error, as one line."""
    print(f"{program}: {printable(reason)}", file=sys.stderr)
