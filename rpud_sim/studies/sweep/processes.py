"""Chunks on local processes: a process that is killed costs the chunk that it was at."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Iterable
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from rpud_sim.studies.sweep.chunks import Chunk, Outcome, Outcomes, simulate
from rpud_sim.studies.sweep.errors import WorkerError

# A chunk that ends so many processes is at fault itself, by the memory that it takes, say.
ATTEMPTS = 3

# Forked from a server that has imported all there is to import, once, and holds nothing of the
# calling process: no threads, locks or files.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["rpud_sim.studies.sweep.chunks"])


def run_on_processes(chunks: Iterable[Chunk], workers: int) -> Outcomes:
    """Yield each chunk with its outcome, as they are finished.

    ``concurrent.futures`` would end all processes when one is killed. Here each has a pipe of its
    own: its end tells this side that the process has gone, and the process that this side has.

    Args:
        chunks: to run; taken one by one, as they are needed.
        workers: number of processes.

    Raises:
        WorkerError: if a chunk ends its process again and again.
    """
    waiting = iter(chunks)
    again: deque[tuple[Chunk, int]] = deque()

    def next_job() -> tuple[Chunk, int] | None:
        if again:
            return again.popleft()
        chunk = next(waiting, None)
        return None if chunk is None else (chunk, 1)

    busy: dict[Connection, tuple[_Worker, Chunk, int]] = {}
    _start_server()
    try:
        for _ in range(workers):
            if (job := next_job()) is None:
                break
            _give(_Worker(), job, busy)
        while busy:
            ready = wait(busy)
            for connection in [item for item in busy if item in ready]:
                worker, chunk, attempt = busy.pop(connection)
                outcome = worker.take()
                if outcome is None:
                    worker.stop()
                    if attempt == ATTEMPTS:
                        raise WorkerError(
                            f"chunk {chunk.number} ended its worker {ATTEMPTS} times ({worker.end})"
                        )
                    again.append((chunk, attempt + 1))
                    worker = _Worker()
                elif isinstance(outcome, Exception):
                    worker.stop()
                    raise outcome
                # The worker goes on before its outcome is written.
                if (job := next_job()) is None:
                    worker.stop()
                else:
                    _give(worker, job, busy)
                if isinstance(outcome, Outcome):
                    yield chunk, outcome
    finally:
        for worker, _, _ in busy.values():
            worker.stop()


class _Worker:
    """A process that answers each chunk with its outcome until nobody asks any more."""

    def __init__(self) -> None:
        self.connection, theirs = _SERVER.Pipe()
        self._process: BaseProcess = _SERVER.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def end(self) -> str:
        """How the process ended."""
        code = self._process.exitcode
        return f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name

    def give(self, chunk: Chunk) -> None:
        """Hand over a chunk; a process that has gone shows when its outcome is taken."""
        with contextlib.suppress(OSError):
            self.connection.send(chunk)

    def take(self) -> Outcome | Exception | None:
        """Return the outcome, or None if the process has gone."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return None

    def stop(self) -> None:
        """End the process; whatever it is at is lost."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def _start_server() -> None:
    """Start what forks the workers, if it does not run yet.

    Ctrl-C goes to all processes of a terminal, and is for the calling one alone to answer: the
    server begins deaf to it, and so do all that it forks.
    """
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, handler)


def _give(
    worker: _Worker, job: tuple[Chunk, int], busy: dict[Connection, tuple[_Worker, Chunk, int]]
) -> None:
    worker.give(job[0])
    busy[worker.connection] = (worker, *job)


def _work(connection: Connection) -> None:
    """Run chunks until the other side has gone."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            chunk = connection.recv()
            outcome: Outcome | Exception
            try:
                outcome = simulate(chunk)
            except Exception as error:  # for the calling process to tell
                outcome = error
            connection.send(outcome)
