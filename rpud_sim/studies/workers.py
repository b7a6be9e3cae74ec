"""Chunks of a study on its workers: local processes, or an existing Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

from rpud_sim.studies.cluster import run_on_cluster
from rpud_sim.studies.processes import Numbered, run_on_processes

_Chunk = TypeVar("_Chunk", bound=Numbered)
_Outcome = TypeVar("_Outcome")


def run_on_workers(
    work: Callable[[_Chunk], _Outcome],
    chunks: Iterable[_Chunk],
    workers: int,
    scheduler: str | None,
    compile_kernels: Callable[[], object],
) -> Generator[tuple[_Chunk, _Outcome], None, None]:
    """Return an iterator over each chunk with its outcome, as they finish.

    Args:
        work: what a worker does with a chunk; a function of a module.
        chunks: to run; an iterator is advanced only as workers need chunks.
        scheduler: address of a Dask cluster to use instead of local processes.
        compile_kernels: compiles what ``work`` calls. It is called once before local processes
            start: otherwise each of them would compile the same kernels.

    Raises:
        WorkerError: if the workers fail.
    """
    if scheduler is not None:
        return run_on_cluster(chunks, scheduler, work)
    compile_kernels()
    return run_on_processes(work, chunks, workers)
