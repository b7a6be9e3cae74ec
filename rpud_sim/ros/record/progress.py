"""One line of progress on a terminal."""

from __future__ import annotations

import sys
import time
from types import TracebackType

_PERIOD = 0.2  # s


class ProgressLine:
    """Rewrites one line of standard error; says nothing where that is no terminal."""

    def __init__(self, title: str) -> None:
        self._title = title
        self._next = time.monotonic() if sys.stderr.isatty() else float("inf")
        self._written = False

    @property
    def is_due(self) -> bool:
        """Whether what it shows is old."""
        return time.monotonic() >= self._next

    def show(self, text: str) -> None:
        """Show `text` now, where it is due."""
        if self.is_due:
            self._next = time.monotonic() + _PERIOD
            self._written = True
            print(f"\r\x1b[K{self._title}: {text}", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> ProgressLine:
        """Give the line itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wipe the line."""
        if self._written:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
