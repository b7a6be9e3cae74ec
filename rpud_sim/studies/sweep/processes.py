"""Chunks on local processes: if one is killed, only its current chunk runs again."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Iterable
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from rpud_sim.studies.sweep.chunks import Chunk, Outcome, Outcomes, WorkerError, simulate

# A chunk that ends so many processes is itself the cause, for example by its memory.
ATTEMPTS = 3

# Workers are forked from a server that has imported everything once, and that shares nothing with
# the calling process: no threads, locks or files.
_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(["rpud_sim.studies.sweep.chunks"])


def run_on_processes(chunks: Iterable[Chunk], workers: int) -> Outcomes:
    """Yield each chunk with its outcome, as they finish.

    ``concurrent.futures`` would end all processes when one is killed. Here each process has its
    own pipe: when it closes, either side knows that the other one has ended.

    Args:
        chunks: to run; an iterator is advanced only as workers need chunks.
        workers: number of processes.

    Raises:
        WorkerError: if a chunk ends its process three times.
    """
    waiting = iter(chunks)
    retries: deque[tuple[Chunk, int]] = deque()

    def next_job() -> tuple[Chunk, int] | None:
        if retries:
            return retries.popleft()
        chunk = next(waiting, None)
        return None if chunk is None else (chunk, 1)

    busy: dict[Connection, tuple[_Worker, Chunk, int]] = {}
    _start_server()
    try:
        for _ in range(workers):
            if (job := next_job()) is None:
                break
            _send(_Worker(), job, busy)
        while busy:
            ready = wait(busy)
            for connection in [item for item in busy if item in ready]:
                worker, chunk, attempt = busy.pop(connection)
                outcome = worker.receive()
                if outcome is None:
                    worker.stop()
                    if attempt == ATTEMPTS:
                        raise WorkerError(
                            f"chunk {chunk.number} ended its worker {ATTEMPTS} times ({worker.end})"
                        )
                    retries.append((chunk, attempt + 1))
                    worker = _Worker()
                elif isinstance(outcome, Exception):
                    worker.stop()
                    raise outcome
                # The worker gets its next chunk before the outcome is written to disk.
                if (job := next_job()) is None:
                    worker.stop()
                else:
                    _send(worker, job, busy)
                if isinstance(outcome, Outcome):
                    yield chunk, outcome
    finally:
        for worker, _, _ in busy.values():
            worker.stop()


class _Worker:
    """Process that answers each chunk with its outcome, until its pipe closes."""

    def __init__(self) -> None:
        self.connection, theirs = _SERVER.Pipe()
        self._process: BaseProcess = _SERVER.Process(target=_work, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def end(self) -> str:
        """Exit code of the process, or the signal that ended it."""
        code = self._process.exitcode
        return f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name

    def send(self, chunk: Chunk) -> None:
        """Send a chunk; if the process has ended, ``receive`` shows it."""
        with contextlib.suppress(OSError):
            self.connection.send(chunk)

    def receive(self) -> Outcome | Exception | None:
        """Return the outcome, or None if the process has ended."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return None

    def stop(self) -> None:
        """End the process; its current chunk is lost."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def _start_server() -> None:
    """Start the server that forks the workers, if it does not run yet.

    A terminal sends Ctrl-C to all of its processes, and only the calling one shall handle it: the
    server ignores the signal, and so do the workers, which inherit that.
    """
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, handler)


def _send(
    worker: _Worker, job: tuple[Chunk, int], busy: dict[Connection, tuple[_Worker, Chunk, int]]
) -> None:
    worker.send(job[0])
    busy[worker.connection] = (worker, *job)


def _work(connection: Connection) -> None:
    """Run chunks until the pipe closes."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            chunk = connection.recv()
            outcome: Outcome | Exception
            try:
                outcome = simulate(chunk)
            except Exception as error:  # the calling process raises it
                outcome = error
            connection.send(outcome)
