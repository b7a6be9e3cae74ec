"""Requests from other threads, done by one thread when it has the time."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, TypeVar

Result = TypeVar("Result")

_LOOK = 0.5  # how often one who waits looks whether there is anything to wait for [s]


class StoppedError(RuntimeError):
    """What was asked for cannot be done any more: the drilling has ended."""


class Requests:
    """Actions that wait for the thread that does them.

    Args:
        notify: called when one more waits.
    """

    def __init__(self, notify: Callable[[], None]) -> None:
        self._notify = notify
        self._waiting: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._closed = threading.Event()

    def do(self, action: Callable[[], Result]) -> Result:
        """Have an action done; return what it returns, raise what it raises.

        Raises:
            StoppedError: if the thread has ended.
        """
        future: Future[Result] = Future()
        self._waiting.append((action, future))
        self._notify()
        return self.wait(future)

    def wait(self, future: Future[Result]) -> Result:
        """Wait for what the thread will do.

        Raises:
            StoppedError: if the thread has ended.
        """
        while True:
            try:
                return future.result(_LOOK)
            except FutureTimeoutError:
                if future.done():  # just now, or with a timeout of its own
                    return future.result()
                if self._closed.is_set():
                    raise StoppedError("the drill has stopped") from None

    def serve(self) -> None:
        """Do what waits, in the thread that does it."""
        while self._waiting:
            action, future = self._waiting.popleft()
            try:
                future.set_result(action())
            except Exception as error:  # it belongs to whoever asked
                future.set_exception(error)

    def close(self) -> None:
        """Refuse what waits, and all that comes."""
        self._closed.set()
        while self._waiting:
            self._waiting.popleft()[1].set_exception(StoppedError("the drill has stopped"))
