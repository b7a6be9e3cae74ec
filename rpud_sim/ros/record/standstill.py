"""Standstills of the recorder: it was frozen, or got no share of the machine."""

from __future__ import annotations

import time

_SHORTEST = 2.0  # between two calls, after which publishers may have dropped the recorder [s]
_SILENCE = 3.0  # after it, in which a connected publisher should send something [s]
_BACKLOG = 1.0  # of these, in which messages from before still arrive and prove nothing [s]


class Standstill:
    """Detector of standstills, by the monotonic clock."""

    def __init__(self) -> None:
        self._called: float | None = None
        self._ended: float | None = None

    def note(self) -> float:
        """Note that the recorder runs; return for how long it stood still before [s], or zero."""
        now = time.monotonic()
        pause = 0.0 if self._called is None else now - self._called
        self._called = now
        if pause < _SHORTEST:
            return 0.0
        self._ended = now
        return pause

    def heard_since(self) -> float | None:
        """Return since when connected publishers must have sent something [s]; None if not now.

        It is returned once after each standstill.
        """
        if self._ended is None or time.monotonic() < self._ended + _SILENCE:
            return None
        since, self._ended = self._ended + _BACKLOG, None
        return since
