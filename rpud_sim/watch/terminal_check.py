"""Check of the terminal before anything is drawn; it needs no library."""

from __future__ import annotations

import os
from collections.abc import Mapping


class NoTerminalError(RuntimeError):
    """No terminal to draw on; the message is one line that says what to use instead."""


def check_terminal(environment: Mapping[str, str] = os.environ) -> None:
    """Check that there is a terminal to draw on.

    Raises:
        NoTerminalError: if input or output is none, or it cannot move its cursor.
    """
    instead = "use `rpud watch` in a browser, or `rpud echo status`"
    if not (os.isatty(0) and os.isatty(1)):
        raise NoTerminalError(f"--terminal needs a terminal for input and output: {instead}")
    if (kind := environment.get("TERM", "")) in ("", "dumb", "unknown"):
        raise NoTerminalError(f"TERM = {kind!r} is no terminal that can be drawn on: {instead}")
