"""Chunks on an existing Dask cluster, which itself retries those of a lost worker."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Iterable
from urllib.parse import urlsplit

from rpud_sim.studies.processes import WorkerError
from rpud_sim.studies.sweep.chunks import Chunk, Outcomes, simulate

CONNECT_TIMEOUT = 10.0  # s
# Chunks in flight for each thread of the cluster: one runs, one waits.
_IN_FLIGHT = 2


def run_on_cluster(chunks: Iterable[Chunk], address: str) -> Outcomes:
    """Yield each chunk with its outcome, as they finish.

    Args:
        chunks: to run; an iterator is advanced only as workers need chunks.
        address: of the scheduler, such as ``tcp://192.168.1.5:8786``.

    Raises:
        WorkerError: if the cluster cannot be reached or cannot run a chunk.
    """
    try:
        from distributed import Client, Future, KilledWorker, as_completed
    except ModuleNotFoundError as error:
        raise WorkerError(
            f"--scheduler needs {error.name}: pip install 'rpud_sim[cluster]'"
        ) from None
    _check_reachable(address)
    with Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False) as client:
        waiting = iter(chunks)
        running: dict[Future, Chunk] = {}
        finished = as_completed(loop=client.loop)

        def fill() -> None:
            wanted = _IN_FLIGHT * max(sum(client.nthreads().values()), 1)
            for chunk in itertools.islice(waiting, max(wanted - len(running), 0)):
                future = client.submit(simulate, chunk, pure=False)
                running[future] = chunk
                finished.add(future)

        fill()
        for future in finished:
            try:
                outcome = future.result()
            except KilledWorker:
                number = running[future].number
                raise WorkerError(f"chunk {number} ended its worker again and again") from None
            except ModuleNotFoundError as error:
                raise WorkerError(
                    f"a worker of {address} has no Python module {error.name}"
                ) from None
            chunk = running.pop(future)
            future.release()
            fill()
            yield chunk, outcome


def _check_reachable(address: str) -> None:
    """Raise WorkerError for an address where no scheduler listens: a client would retry forever."""
    try:
        parts = urlsplit(address)
        if parts.scheme != "tcp" or not parts.hostname or parts.port is None:
            raise ValueError("it must be tcp://HOST:PORT")
        socket.create_connection((parts.hostname, parts.port), CONNECT_TIMEOUT).close()
    except (OSError, ValueError) as error:
        raise WorkerError(f"--scheduler {address}: cannot be reached: {error}") from None
