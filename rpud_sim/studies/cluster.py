"""Chunks on an existing Dask cluster, which itself retries those of a lost worker."""

from __future__ import annotations

import contextlib
import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.studies.workers import Numbered, WorkerError

if TYPE_CHECKING:
    from distributed import Future

CONNECT_TIMEOUT = 10.0  # s
# How long a study waits until a scheduler that it has lost is restarted [s].
RESTART_TIMEOUT = 300.0
# Chunks in flight for each thread of the cluster: one runs, one waits.
_IN_FLIGHT = 2
# Time between two questions whether the scheduler is still the same, with how many threads [s].
_LOOK_PERIOD = 1.0
_RETRY_PERIOD = 0.2  # between two attempts to reach the scheduler [s]

_Chunk = TypeVar("_Chunk", bound=Numbered)
_Outcome = TypeVar("_Outcome")


class _SchedulerLostError(Exception):
    """The chunks in flight, its arguments, are lost."""


def run_on_cluster(
    chunks: Iterable[_Chunk], address: str, work: Callable[[_Chunk], _Outcome]
) -> Generator[tuple[_Chunk, _Outcome], None, None]:
    """Yield each chunk once, with its outcome, as they finish.

    If the scheduler is lost, the chunks in flight are submitted again when another one listens at
    its address, such as ``tcp://192.168.1.5:8786``. A cluster that cannot be reached, or cannot run
    a chunk, is a WorkerError.
    """
    try:
        import distributed  # noqa: F401
    except ModuleNotFoundError as error:
        raise WorkerError(
            f"--scheduler needs {error.name}: pip install 'rpud_sim[cluster]'"
        ) from None
    _check_reachable(address)
    further = iter(chunks)
    lost: deque[_Chunk] = deque()  # in flight when the scheduler was lost

    def take() -> _Chunk | None:
        return lost.popleft() if lost else next(further, None)

    with _quiet_log():
        while True:
            try:
                yield from _run_on_scheduler(take, address, work)
                return
            except _SchedulerLostError as error:
                lost.extend(error.args)
                _wait_for_scheduler(address)


@contextlib.contextmanager
def _quiet_log() -> Iterator[None]:
    """Keep Dask from printing tracebacks of a lost connection, which is dealt with here."""
    names = ("distributed", "distributed.client", "distributed.comm", "distributed.core")
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _run_on_scheduler(
    take: Callable[[], _Chunk | None], address: str, work: Callable[[_Chunk], _Outcome]
) -> Generator[tuple[_Chunk, _Outcome], None, None]:
    """Yield chunks with their outcomes until there are no more to take."""
    from distributed import Client
    from distributed.client import FutureCancelledError

    running: dict[Future, _Chunk] = {}
    finished: SimpleQueue[Future] = SimpleQueue()
    try:
        with Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False) as client:
            scheduler, threads, due = client.scheduler_info()["id"], 1, 0.0

            def fill() -> None:
                nonlocal threads, due
                if time.monotonic() >= due:
                    if client.scheduler_info()["id"] != scheduler:  # it knows of no chunk
                        raise ConnectionResetError("another scheduler")
                    threads = max(sum(client.nthreads().values()), 1)
                    due = time.monotonic() + _LOOK_PERIOD
                while len(running) < _IN_FLIGHT * threads and (chunk := take()) is not None:
                    future = client.submit(work, chunk, pure=False)
                    running[future] = chunk
                    future.add_done_callback(finished.put)

            fill()
            while running:
                try:
                    future = finished.get(timeout=_LOOK_PERIOD)
                except Empty:
                    fill()  # there may be more workers
                    continue
                outcome: _Outcome = _outcome(future, running[future], address)
                chunk = running.pop(future)
                future.release()
                fill()
                yield chunk, outcome
    except (FutureCancelledError, OSError, TimeoutError):
        raise _SchedulerLostError(*running.values()) from None


def _outcome(future: Future, chunk: Numbered, address: str) -> Any:
    """Return the outcome of a chunk that has finished."""
    from distributed import KilledWorker

    try:
        return future.result()
    except KilledWorker:
        raise WorkerError(f"chunk {chunk.number} ended its worker again and again") from None
    except ModuleNotFoundError as error:
        raise WorkerError(f"a worker of {address} has no Python module {error.name}") from None
    except (OSError, TimeoutError) as error:
        if future.status != "error":
            raise  # the scheduler's end, not the chunk's
        raise WorkerError(f"chunk {chunk.number}: a worker of {address} failed: {error}") from None


def _wait_for_scheduler(address: str) -> None:
    """Wait until a scheduler listens again at an address."""
    deadline = time.monotonic() + RESTART_TIMEOUT
    while True:
        try:
            return _check_reachable(address)
        except WorkerError:
            if time.monotonic() >= deadline:
                raise
        time.sleep(_RETRY_PERIOD)


def _check_reachable(address: str) -> None:
    """Raise WorkerError for an address where no scheduler answers: a client would wait forever."""
    try:
        parts = urlsplit(address)
        if parts.scheme != "tcp" or not parts.hostname or parts.port is None:
            raise ValueError("it must be tcp://HOST:PORT")
        with socket.create_connection((parts.hostname, parts.port), CONNECT_TIMEOUT) as connection:
            # A scheduler begins with its versions, before it is asked.
            if not connection.recv(1):
                raise ConnectionResetError("it is no Dask scheduler")
    except TimeoutError:
        raise WorkerError(
            f"--scheduler {address}: cannot be reached: no answer of a Dask scheduler in "
            f"{CONNECT_TIMEOUT:g} s"
        ) from None
    except OSError as error:
        raise WorkerError(f"--scheduler {address}: cannot be reached: {error}") from None
    except ValueError as error:
        raise ParameterError(f"--scheduler = {address!r}: {error}") from None
