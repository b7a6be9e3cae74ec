"""Requests from any thread, which one thread serves."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any

_POLL_PERIOD = 0.5  # between checks that the thread is still alive [s]


class StoppedError(RuntimeError):
    """A request that cannot be served: the thread has ended, or has not begun."""


class Requests:
    """Queue of actions for the thread that serves them; ``notify`` is called for each."""

    def __init__(self, notify: Callable[[], None]) -> None:
        self._notify = notify
        self._waiting: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._closed = threading.Event()
        self._server: threading.Thread | None = None

    def do(self, action: Callable[[], Any]) -> Any:
        """Have an action done; return what it returns, raise what it raises.

        If it returns a Future, wait for that, and return its result. The serving thread itself does
        an action at once, and waits for no Future: it would wait for itself. If the thread has
        ended, it raises a StoppedError.
        """
        if threading.current_thread() is self._server:
            return action()
        done: Future[Any] = Future()
        self._waiting.append((action, done))
        self._notify()
        result = self._wait(done)
        return self._wait(result) if isinstance(result, Future) else result

    def serve(self) -> None:
        """Do what waits; the calling thread is the serving one."""
        self._server = threading.current_thread()
        while self._waiting:
            action, future = self._waiting.popleft()
            try:
                future.set_result(action())
            except Exception as error:  # for the thread that asked
                future.set_exception(error)

    def close(self) -> None:
        """Reject waiting and later actions."""
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
