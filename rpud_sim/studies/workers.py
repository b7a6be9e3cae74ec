"""Workers of a study: local processes, or an existing Dask cluster.

Chunks that are in flight when workers are lost run again; a cluster itself retries those of a lost
worker.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    wait,
)
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from typing import Any, Protocol, TypeVar
from urllib.parse import urlsplit

from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.simulation.versions import engine_versions

# A chunk that ends so many processes is itself the cause, for example by its memory.
ATTEMPTS = 3
# Chunks in flight for each worker: one runs, one waits.
IN_FLIGHT = 2
CONNECT_TIMEOUT = 10.0  # to a scheduler [s]
# How long a study waits until a scheduler that it has lost is restarted [s].
RESTART_TIMEOUT = 300.0
_RETRY_PERIOD = 0.2  # between two attempts to reach the scheduler [s]
_LOOK_PERIOD = 1.0  # between two questions how many chunks may be in flight [s]

# Workers are forked from a server that has imported everything once, and that shares nothing with
# the calling process: no threads, locks or files.
_SERVER = multiprocessing.get_context("forkserver")


class WorkerError(ExpectedError, RuntimeError):
    """Workers that cannot run a study; the text gives the reason in one line."""


class LostError(Exception):
    """The chunks in flight, its arguments, are lost with their workers."""


class StudyChunk(Protocol):
    """Runs that one worker does at once."""

    @property
    def number(self) -> int:
        """Number of the chunk, for messages."""

    @property
    def count(self) -> int:
        """Number of its runs."""


_Chunk = TypeVar("_Chunk", bound=StudyChunk)
_Outcome = TypeVar("_Outcome")
Outcomes = Generator[tuple[_Chunk, _Outcome], None, None]


def check_versions(expected: Mapping[str, str]) -> None:
    """Raise a WorkerError unless this process gives the same bits as the study's machine."""
    own = engine_versions()
    for name, version in expected.items():
        if own[name] != version:
            raise WorkerError(f"a worker has {name} {own[name]}, this machine {version}")


def run_chunks(
    work: Callable[[_Chunk], _Outcome],
    chunks: Iterable[_Chunk],
    workers: int,
    scheduler: str | None = None,
) -> Outcomes[_Chunk, _Outcome]:
    """Yield each chunk with its outcome, as they finish.

    ``work`` is a function of a module. Compile what it calls before, or each process would.
    ``scheduler`` is the address of a Dask cluster to use instead of local processes.
    """
    if scheduler is None:
        return _run_on_processes(work, iter(chunks), workers)
    return _run_on_cluster(work, iter(chunks), scheduler)


def _run_on_processes(
    work: Callable[[_Chunk], _Outcome], chunks: Iterator[_Chunk], workers: int
) -> Outcomes[_Chunk, _Outcome]:
    while True:
        try:
            with _open_pool(work, workers) as pool:
                return (
                    yield from _keep_busy(
                        lambda chunk: pool.submit(work, chunk), chunks, lambda: IN_FLIGHT * workers
                    )
                )
        except LostError as error:
            # A pool does not say which chunk ended a process: each is tried by itself.
            for chunk in error.args:
                yield chunk, _run_alone(work, chunk)


def _keep_busy(
    submit: Callable[[_Chunk], Future[_Outcome]],
    chunks: Iterator[_Chunk],
    room: Callable[[], int],
    result: Callable[[Future[_Outcome], _Chunk], _Outcome] = lambda future, chunk: future.result(),
) -> Outcomes[_Chunk, _Outcome]:
    """Submit chunks while there is room, and yield them with their outcomes.

    Workers get their next chunks before an outcome is written to disk. A LostError has the chunks
    in flight if their executor is broken, or cancels them.
    """
    taken: dict[int, _Chunk] = {}
    running: dict[Future[_Outcome], int] = {}
    try:
        while True:
            for chunk in itertools.islice(chunks, max(room() - len(running), 0)):
                taken[chunk.number] = chunk
                running[submit(chunk)] = chunk.number
            if not running:
                return
            for future in wait(running, _LOOK_PERIOD, FIRST_COMPLETED).done:
                outcome = result(future, taken[running[future]])
                yield taken.pop(running.pop(future)), outcome
    except (BrokenExecutor, CancelledError):
        raise LostError(*taken.values()) from None


def _run_alone(work: Callable[[_Chunk], _Outcome], chunk: _Chunk) -> _Outcome:
    for _ in range(ATTEMPTS):
        with contextlib.suppress(BrokenExecutor), _open_pool(work, 1) as pool:
            return pool.submit(work, chunk).result()
    raise WorkerError(f"chunk {chunk.number} ended its worker {ATTEMPTS} times")


@contextlib.contextmanager
def _open_pool(work: Callable[[Any], Any], workers: int) -> Iterator[ProcessPoolExecutor]:
    """Context with a pool, whose processes end with it, in the middle of their chunks."""
    _SERVER.set_forkserver_preload([work.__module__])
    # A terminal sends Ctrl-C to all of its processes, and only the calling one shall handle it:
    # server and workers inherit that it is ignored.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, handler)
    theirs, ours = _SERVER.Pipe(duplex=False)
    pool = ProcessPoolExecutor(workers, _SERVER, _end_with, (theirs,))
    try:
        yield pool
    finally:
        ours.close()
        pool.shutdown(cancel_futures=True)
        theirs.close()


def _end_with(lifeline: Connection) -> None:
    """Let this process end when the other end of a pipe is closed."""

    def end() -> None:
        with contextlib.suppress(EOFError, OSError):
            lifeline.recv_bytes()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _run_on_cluster(
    work: Callable[[_Chunk], _Outcome], chunks: Iterator[_Chunk], address: str
) -> Outcomes[_Chunk, _Outcome]:
    """Yield chunks from a cluster; those in flight are submitted again to a restarted scheduler."""
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
        yield from _keep_busy(submit, chunks, room, result)
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
