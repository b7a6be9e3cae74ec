"""Chunks of work on local processes: if one is killed, only its current chunk runs again."""

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

from rpud_sim.simulation.versions import engine_versions

# A chunk that ends so many processes is itself the cause, for example by its memory.
ATTEMPTS = 3

# Workers are forked from a server that has imported everything once, and that shares nothing with
# the calling process: no threads, locks or files.
_SERVER = multiprocessing.get_context("forkserver")


class WorkerError(RuntimeError):
    """Workers that cannot run a study; the text gives the reason in one line."""


class Numbered(Protocol):
    """Chunk of work."""

    @property
    def number(self) -> int:
        """Number of the chunk, for messages."""


_Chunk = TypeVar("_Chunk", bound=Numbered)
_Outcome = TypeVar("_Outcome")


def check_versions(expected: Mapping[str, str]) -> None:
    """Check that this process would give the same bits as the study's machine.

    Raises:
        WorkerError: if a version differs.
    """
    own = engine_versions()
    for name, version in expected.items():
        if own[name] != version:
            raise WorkerError(f"a worker has {name} {own[name]}, this machine {version}")


def run_on_processes(
    simulate: Callable[[_Chunk], _Outcome],
    chunks: Iterable[_Chunk],
    workers: int,
    grace: float = 0.0,
) -> Generator[tuple[_Chunk, _Outcome], None, None]:
    """Yield each chunk with its outcome, as they finish.

    ``concurrent.futures`` would end all processes when one is killed. Here each process has its
    own pipe: when it closes, either side knows that the other one has ended.

    Args:
        simulate: returns the outcome of a chunk; a function of a module, not None.
        chunks: to run; an iterator is advanced only as workers need chunks.
        grace: longest time for a process to end what it has started itself [s].

    Raises:
        WorkerError: if a chunk ends its process three times.
    """
    waiting = iter(chunks)
    retries: deque[tuple[_Chunk, int]] = deque()

    def next_job() -> tuple[_Chunk, int] | None:
        if retries:
            return retries.popleft()
        chunk = next(waiting, None)
        return None if chunk is None else (chunk, 1)

    busy: dict[Connection, tuple[_Worker, _Chunk, int]] = {}
    _start_server(simulate.__module__)
    try:
        for _ in range(workers):
            if (job := next_job()) is None:
                break
            _send(_Worker(simulate, grace), job, busy)
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
                    worker = _Worker(simulate, grace)
                elif isinstance(outcome, Exception):
                    worker.stop()
                    raise outcome
                # The worker gets its next chunk before the outcome is written to disk.
                if (job := next_job()) is None:
                    worker.stop()
                else:
                    _send(worker, job, busy)
                if outcome is not None:
                    yield chunk, outcome
    finally:
        for worker, _, _ in busy.values():
            worker.ask_to_stop()
        for worker, _, _ in busy.values():
            worker.stop()


class _Worker:
    """Process that answers each chunk with its outcome, until its pipe closes.

    Args:
        grace: longest time for the process to end what it has started itself [s].
    """

    def __init__(self, simulate: Callable[[Any], Any], grace: float) -> None:
        self._grace = grace
        self.connection, theirs = _SERVER.Pipe()
        self._process: BaseProcess = _SERVER.Process(
            target=_work, args=(theirs, simulate), daemon=True
        )
        self._process.start()
        theirs.close()

    @property
    def end(self) -> str:
        """Exit code of the process, or the signal that ended it."""
        code = self._process.exitcode
        return f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name

    def send(self, chunk: Any) -> None:
        """Send a chunk; if the process has ended, ``receive`` shows it."""
        with contextlib.suppress(OSError):
            self.connection.send(chunk)

    def receive(self, number: int) -> Any:
        """Return the outcome or an exception; None if the process has ended."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            return None
        except Exception as error:  # of pickle, after everything was received
            return _pickling_error(number, "unpickled", error)

    def ask_to_stop(self) -> None:
        """Ask the process to end, if it gets time for that."""
        self.connection.close()
        if self._grace:
            self._process.terminate()

    def stop(self) -> None:
        """End the process; its current chunk is lost."""
        self.ask_to_stop()
        if self._grace:
            self._process.join(self._grace)
        self._process.kill()
        self._process.join()


def _end(number: int, frame: object) -> None:
    """End the process by its own cleanup, at the first SIGTERM."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(0)


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


def _send(worker: _Worker, job: tuple[Any, int], busy: dict[Connection, Any]) -> None:
    worker.send(job[0])
    busy[worker.connection] = (worker, *job)


def _work(connection: Connection, simulate: Callable[[Any], Any]) -> None:
    """Run chunks until the pipe closes."""
    signal.signal(signal.SIGTERM, _end)
    with contextlib.suppress(EOFError, OSError):
        while True:
            chunk = connection.recv()
            try:
                outcome = simulate(chunk)
            except Exception as error:  # the calling process raises it
                outcome = error
            try:
                connection.send(outcome)
            except OSError:
                raise
            except Exception as error:  # of pickle, before anything is sent
                connection.send(_pickling_error(chunk.number, "pickled", error))
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends by itself
