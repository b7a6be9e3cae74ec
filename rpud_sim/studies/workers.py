"""Chunks of a study on its workers: local processes, or a Dask cluster.

If workers are lost, the chunks that were in flight run again.
"""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import signal
import threading
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

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.simulation.versions import engine_versions

# A chunk that ends so many processes is itself the cause, for example by its memory.
ATTEMPTS = 3
# Chunks in flight for each worker: one runs, one waits.
IN_FLIGHT = 2
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
    further = iter(chunks)
    if scheduler is not None:
        from rpud_sim.studies.cluster import run_on_cluster

        return (yield from run_on_cluster(work, further, scheduler))
    while True:
        try:
            with _open_pool(work, workers) as pool:
                return (
                    yield from keep_busy(
                        lambda chunk: pool.submit(work, chunk), further, lambda: IN_FLIGHT * workers
                    )
                )
        except LostError as error:
            # A pool does not say which chunk ended a process: each is tried by itself.
            for chunk in error.args:
                yield chunk, _run_alone(work, chunk)


def keep_busy(
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
