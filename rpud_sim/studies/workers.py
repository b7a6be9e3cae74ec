"""Chunks of a study on its workers: local processes.

If a process is killed, only its current chunk runs again.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping
from multiprocessing import forkserver
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar

from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.simulation.versions import engine_versions

# A chunk that ends so many processes is itself the cause, for example by its memory.
ATTEMPTS = 3

# Workers are forked from a server that has imported everything once, and that shares nothing with
# the calling process: no threads, locks or files.
_SERVER = multiprocessing.get_context("forkserver")


class WorkerError(ExpectedError, RuntimeError):
    """Workers that cannot run a study; the text gives the reason in one line."""


class Numbered(Protocol):
    """Chunk of work."""

    @property
    def number(self) -> int:
        """Number of the chunk, for messages."""


_Chunk = TypeVar("_Chunk", bound=Numbered)
_Outcome = TypeVar("_Outcome")


def check_versions(expected: Mapping[str, str]) -> None:
    """Raise a WorkerError unless this process gives the same bits as the study's machine."""
    own = engine_versions()
    for name, version in expected.items():
        if own[name] != version:
            raise WorkerError(f"a worker has {name} {own[name]}, this machine {version}")


def run_on_processes(
    work: Callable[[_Chunk], _Outcome], chunks: Iterable[_Chunk], workers: int
) -> Generator[tuple[_Chunk, _Outcome], None, None]:
    """Yield each chunk with its outcome, as they finish.

    ``work`` is a function of a module. Compile what it calls before, or each process would.

    ``concurrent.futures`` would end all processes when one is killed. Here each process has its
    own pipe: when it closes, either side knows that the other one has ended.
    """
    waiting = ((chunk, 1) for chunk in chunks)
    retries: deque[tuple[_Chunk, int]] = deque()
    busy: dict[Connection, tuple[_Worker, _Chunk, int]] = {}

    def send_next(worker: _Worker | None = None) -> None:
        """Send the next chunk to a worker, or a new one; stop the worker if there is none."""
        job = retries.popleft() if retries else next(waiting, None)
        if job is not None:
            worker = worker or _Worker(work)
            # If the process has ended, ``receive`` shows it.
            with contextlib.suppress(OSError):
                worker.connection.send(job[0])
            busy[worker.connection] = (worker, *job)
        elif worker is not None:
            worker.stop()

    _start_server(work.__module__)
    try:
        for _ in range(workers):
            send_next()
        while busy:
            ready = wait(busy)
            for connection in [item for item in busy if item in ready]:
                worker, chunk, attempt = busy.pop(connection)
                outcome = worker.receive(chunk.number)
                if outcome is None:
                    worker.stop()
                    if attempt == ATTEMPTS:
                        raise WorkerError(
                            f"chunk {chunk.number} ended its worker {ATTEMPTS} times ({worker.end})"
                        )
                    retries.append((chunk, attempt + 1))
                    send_next()
                elif isinstance(outcome, Exception):
                    worker.stop()
                    raise outcome
                else:
                    # The worker gets its next chunk before the outcome is written to disk.
                    send_next(worker)
                    yield chunk, outcome
    finally:
        for worker, _, _ in busy.values():
            worker.stop()


class _Worker:
    """Process that answers each chunk with its outcome, until its pipe closes."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.connection, theirs = _SERVER.Pipe()
        self._process: BaseProcess = _SERVER.Process(target=_work, args=(theirs, work), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def end(self) -> str:
        """Exit code of the process, or the signal that ended it."""
        code = self._process.exitcode
        return f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name

    def receive(self, number: int) -> Any:
        """Return the outcome or an exception; None if the process has ended."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return None
        except Exception as error:  # of pickle, after everything was received
            return _pickling_error(number, "unpickled", error)

    def stop(self) -> None:
        """End the process; its current chunk is lost."""
        self.connection.close()
        self._process.kill()
        self._process.join()


def _start_server(module: str) -> None:
    """Start the server that forks the workers, if it does not run yet; it imports a module first.

    A terminal sends Ctrl-C to all of its processes, and only the calling one shall handle it: the
    server ignores the signal, and so do the workers, which inherit that.
    """
    _SERVER.set_forkserver_preload([module])
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        forkserver.ensure_running()
    finally:
        signal.signal(signal.SIGINT, handler)


def _pickling_error(number: int, done: str, error: Exception) -> WorkerError:
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return WorkerError(f"the outcome of chunk {number} cannot be {done}: {reason:.300}")


def _work(connection: Connection, work: Callable[[Any], Any]) -> None:
    """Run chunks until the pipe closes."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            chunk = connection.recv()
            try:
                outcome = work(chunk)
            except Exception as error:  # the calling process raises it
                outcome = error
            try:
                connection.send(outcome)
            except OSError:
                raise
            except Exception as error:  # of pickle, before anything is sent
                connection.send(_pickling_error(chunk.number, "pickled", error))
