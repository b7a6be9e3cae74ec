"""Requests from other threads, done by one thread when it has the time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any

_POLL_PERIOD = 0.5  # between checks that the thread is still alive [s]


class StoppedError(RuntimeError):
    """A request that comes too late: the drilling has ended."""


class Requests:
    """Queue of actions for the thread that does them.

    Args:
        notify: called when one more waits.
    """

    def __init__(self, notify: Callable[[], None]) -> None:
        self._notify = notify
        self._waiting: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._closed = threading.Event()

    def do(self, action: Callable[[], Any]) -> Any:
        """Have an action done; return what it returns, raise what it raises.

        Of an action that returns a Future it is the Future's result.

        Raises:
            StoppedError: if the thread has ended.
        """
        done: Future[Any] = Future()
        self._waiting.append((action, done))
        self._notify()
        result = self._wait(done)
        return self._wait(result) if isinstance(result, Future) else result

    def serve(self) -> None:
        """Do what waits, in the thread that does it."""
        while self._waiting:
            action, future = self._waiting.popleft()
            try:
                future.set_result(action())
            except Exception as error:  # it belongs to the thread that asked
                future.set_exception(error)

    def close(self) -> None:
        """Refuse what waits, and all that comes."""
        self._closed.set()
        while self._waiting:
            self._waiting.popleft()[1].set_exception(StoppedError("the drill has stopped"))

    def _wait(self, future: Future[Any]) -> Any:
        while True:
            try:
                return future.result(_POLL_PERIOD)
            except FutureTimeoutError:
                if future.done():  # just now, or with a timeout of its own
                    return future.result()
                if self._closed.is_set():
                    raise StoppedError("the drill has stopped") from None
