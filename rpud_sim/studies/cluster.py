"""Chunks on an existing Dask cluster, which itself retries those of a lost worker."""

from __future__ import annotations

import contextlib
import itertools
import logging
import socket
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from typing import TypeVar
from urllib.parse import urlsplit

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.studies.workers import (
    IN_FLIGHT,
    LostError,
    Outcomes,
    StudyChunk,
    WorkerError,
    keep_busy,
)

CONNECT_TIMEOUT = 10.0  # s
# How long a study waits until a scheduler that it has lost is restarted [s].
RESTART_TIMEOUT = 300.0
_RETRY_PERIOD = 0.2  # between two attempts to reach the scheduler [s]

_Chunk = TypeVar("_Chunk", bound=StudyChunk)
_Outcome = TypeVar("_Outcome")


def run_on_cluster(
    work: Callable[[_Chunk], _Outcome], chunks: Iterator[_Chunk], address: str
) -> Outcomes[_Chunk, _Outcome]:
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
    for name in ("distributed", *(f"distributed.{part}" for part in ("client", "comm", "core"))):
        # It would print tracebacks of a lost connection, which is dealt with here.
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    while True:
        try:
            return (yield from _run_on_scheduler(work, chunks, address))
        except (CancelledError, LostError) as error:  # cancelled before there was a chunk
            chunks = itertools.chain(error.args, chunks)
            _wait_for_scheduler(address)


def _run_on_scheduler(
    work: Callable[[_Chunk], _Outcome], chunks: Iterator[_Chunk], address: str
) -> Outcomes[_Chunk, _Outcome]:
    """Yield chunks with their outcomes until there are no more, or the scheduler is lost."""
    from distributed import Client, KilledWorker

    with _losing_scheduler():
        client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        executor = client.get_executor(pure=False)
        scheduler = client.scheduler_info()["id"]

    def room() -> int:
        with _losing_scheduler():
            if client.scheduler_info()["id"] != scheduler:  # it knows of no chunk
                raise CancelledError
            return IN_FLIGHT * max(sum(client.nthreads().values()), 1)

    def submit(chunk: _Chunk) -> Future[_Outcome]:
        with _losing_scheduler():
            return executor.submit(work, chunk)

    def result(future: Future[_Outcome], chunk: _Chunk) -> _Outcome:
        try:
            return future.result()
        except KilledWorker:
            reason = f"chunk {chunk.number} ended its worker again and again"
        except ModuleNotFoundError as error:
            reason = f"a worker of {address} has no Python module {error.name}"
        except OSError as error:
            reason = f"chunk {chunk.number}: a worker of {address} failed: {error}"
        raise WorkerError(reason)

    try:
        yield from keep_busy(submit, chunks, room, result)
    finally:
        with contextlib.suppress(OSError):  # or the chunks in flight would be forgotten
            client.close()


@contextlib.contextmanager
def _losing_scheduler() -> Iterator[None]:
    """Errors of the connection mean that the scheduler is lost, with all chunks in flight."""
    try:
        yield
    except OSError:  # also timeouts
        raise CancelledError from None


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
