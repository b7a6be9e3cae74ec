"""Chunks of a sweep on local processes."""

from __future__ import annotations

from collections.abc import Iterable

from rpud_sim.studies import processes
from rpud_sim.studies.sweep.chunks import Chunk, Outcomes, simulate


def run_on_processes(chunks: Iterable[Chunk], workers: int) -> Outcomes:
    """Yield each chunk with its outcome, as they finish; see ``studies.processes``.

    Args:
        chunks: to run.
        workers: number of processes.

    Raises:
        WorkerError: if a chunk ends its process three times.
    """
    return processes.run_on_processes(simulate, chunks, workers)
