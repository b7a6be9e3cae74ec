"""Times in which the recorder stood still: frozen, or without a share of the machine."""

from __future__ import annotations

import time

_LONGEST = 2.0  # s between two calls after which publishers may have given the recorder up
_SILENCE = 3.0  # s after it in which a publisher that is connected should be heard
_BACKLOG = 1.0  # s of these in which messages from before still arrive, which prove nothing


class Standstill:
    """Finds standstills by the monotonic clock, and what is silent after one."""

    def __init__(self) -> None:
        self._called: float | None = None
        self._ended: float | None = None

    def note(self) -> float:
        """Note that the recorder is at work; give the seconds for which it stood still, or zero."""
        now = time.monotonic()
        pause = 0.0 if self._called is None else now - self._called
        self._called = now
        if pause < _LONGEST:
            return 0.0
        self._ended = now
        return pause

    def heard_since(self) -> float | None:
        """Give the time since which publishers must have been heard [s]; None if not now.

        It is given once after each standstill.
        """
        if self._ended is None or time.monotonic() < self._ended + _SILENCE:
            return None
        since, self._ended = self._ended + _BACKLOG, None
        return since
