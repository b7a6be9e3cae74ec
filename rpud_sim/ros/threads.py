"""Threads with deadlines: requests to them, their delays, and executors that yield to them."""

from __future__ import annotations

import gc
import os
import sys
import threading
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import contextmanager
from functools import partial
from math import inf
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor

from rpud_sim.foundation.quantities import ExpectedError, truncated

_POLL_PERIOD = 0.1  # between checks that requests are served [s]
_LONGEST_WAIT = 0.1  # for a callback that is ready [s]
_SWITCH_INTERVAL = 1e-4  # after which Python lets another thread continue, 5 ms by default [s]
_LONGEST_LINE = 500  # characters
_STEPS_PER_OCTAVE = 16  # bounds are 4.4 % apart
_OCTAVES = 64
# Delays below a microsecond are one step. To look up the bound is quicker than its logarithm.
_BOUNDS = [1e3 * 2 ** (step / _STEPS_PER_OCTAVE) for step in range(_OCTAVES * _STEPS_PER_OCTAVE)]
_BOUNDS.append(inf)


class RequestError(ExpectedError):
    """A request that is rejected, interrupted or comes too late; nothing has changed.

    ``result`` is a number of ``rpud_msgs/Result``; without one the state does not permit it.
    """

    def __init__(self, reason: str, result: int | None = None) -> None:
        super().__init__(reason)
        self.result = result


class Requests:
    """Queue of actions for the thread that serves them; ``notify`` is called for each.

    After its end a request raises a RequestError with the text ``stopped``.
    """

    def __init__(self, notify: Callable[[], None], stopped: str = "the drill has stopped") -> None:
        self._notify = notify
        self._stopped = stopped
        self._waiting: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._closed = False
        self._server: threading.Thread | None = None

    def do(self, action: Callable[[], Any]) -> Any:
        """Have an action done; return its result, or its Future's; raise what it raises."""
        if threading.current_thread() is self._server:
            return action()
        result: Future[Any] = Future()
        self._waiting.append((action, result))
        self._notify()
        while True:
            closed = self._closed
            try:
                return result.result(_POLL_PERIOD)
            except FutureTimeoutError:
                if result.done():  # just now, or with a timeout of its own
                    return result.result()
                if closed:
                    raise RequestError(self._stopped) from None

    def serve(self) -> None:
        """Do what waits; the calling thread is the serving one."""
        self._server = threading.current_thread()
        while self._waiting:
            action, result = self._waiting.popleft()
            try:
                found = action()
            except Exception as error:  # for the thread that asked
                result.set_exception(error)
                continue
            if isinstance(found, Future):  # the thread that asked is woken once, at its end
                found.add_done_callback(partial(_pass_on, result))
            else:
                result.set_result(found)

    def close(self) -> None:
        """Serve no more: requests that wait raise a RequestError."""
        self._closed = True


def _pass_on(result: Future[Any], source: Future[Any]) -> None:
    """Give a future the result of another one that is done, or its error."""
    if error := source.exception():
        result.set_exception(error)
    else:
        result.set_result(source.result())


def schedule_thread(priority: int) -> str:
    """Schedule this thread by SCHED_FIFO, or time-sharing for 0; return how it is scheduled."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK if priority else os.SCHED_OTHER
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return f"time-sharing: real-time priority {priority}: {error.strerror}"
    return f"real-time priority {priority}" if priority else "time-sharing"


@contextmanager
def quick_switches() -> Iterator[None]:
    """Let a thread that publishes continue soon while an executor is busy in another one."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_SWITCH_INTERVAL)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@contextmanager
def settled_memory() -> Iterator[None]:
    """Keep what exists now out of Python's search for unused objects, which stops every thread."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def serve(executor: Executor, failed: Callable[[str], None]) -> None:
    """Execute the next callback of an executor's nodes, or return after 0.1 s without any.

    rclpy raises errors at some messages of other processes, which must not end the program:
    ``failed`` is called with one line.
    """
    try:
        executor.spin_once(timeout_sec=_LONGEST_WAIT)
    except InvalidHandle:
        return
    except Exception as error:
        failed(raised(error))


def raised(error: Exception) -> str:
    """Return one line about an error that a message from the network has caused."""
    return truncated(
        f"it raised {type(error).__name__}: {' '.join(str(error).split())}", _LONGEST_LINE
    )


class DelayHistogram:
    """Histogram of delays; an early or punctual event counts as zero."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self._greatest = 0.0

    @property
    def count(self) -> int:
        return self._counts.total()

    def add(self, nanoseconds: float) -> None:
        """Add a delay [ns]."""
        self._counts[bisect_left(_BOUNDS, nanoseconds)] += 1
        if nanoseconds > self._greatest:
            self._greatest = nanoseconds

    def quantile(self, share: float) -> float:
        """Return the delay [s] that a share of all do not exceed, up to 4.4 % or 1 us too large."""
        wanted = share * self.count
        for step in sorted(self._counts):
            wanted -= self._counts[step]
            if wanted <= 0:
                return min(_BOUNDS[step], self._greatest) / 1e9
        return self.greatest

    @property
    def greatest(self) -> float:
        """Greatest delay [s]; 0 without any."""
        return self._greatest / 1e9

    def __str__(self) -> str:
        """Return median, 99 % quantile and maximum in milliseconds."""
        return (
            f"late {1e3 * self.quantile(0.5):.3g} ms (median), "
            f"{1e3 * self.quantile(0.99):.3g} ms (99 %), {1e3 * self.greatest:.3g} ms (most)"
        )
