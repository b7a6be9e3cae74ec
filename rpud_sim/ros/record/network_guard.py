"""Guard against invalid data from the network: it must not end a recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_LOG_PERIOD = 10.0  # between two lines [s]


class NetworkGuard:
    """Suppresses, counts and logs errors that data from the network raises."""

    def __init__(self, logger: Any) -> None:
        self.count = 0  # suppressed errors
        self._logger = logger
        self._next_line = float("-inf")

    @contextmanager
    def __call__(self, what: str) -> Iterator[None]:
        """Guard a block; the log names what it receives."""
        try:
            yield
        except Exception as error:  # the data may make a library raise anything
            self.count += 1
            if time.monotonic() >= self._next_line:
                self._next_line = time.monotonic() + _LOG_PERIOD
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                self._logger.warning(f"{what} cannot be used: {reason:.200}")
