"""What arrives over the network may be anything: nothing of it ends a recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_PERIOD = 10.0  # s between two lines of the log


class NetworkGuard:
    """Passes over what raises an error while it is taken from the network; counts and logs it.

    Args:
        logger: of the node.
    """

    def __init__(self, logger: Any) -> None:
        self.count = 0
        """Errors that were passed over."""
        self._logger = logger
        self._next_line = float("-inf")

    @contextmanager
    def __call__(self, what: str) -> Iterator[None]:
        """Guard a block that takes `what`, which the log names."""
        try:
            yield
        except Exception as error:  # a stranger decides what is raised here
            self.count += 1
            if time.monotonic() >= self._next_line:
                self._next_line = time.monotonic() + _PERIOD
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                self._logger.warning(f"{what} cannot be used: {reason:.200}")
