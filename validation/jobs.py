"""Independent jobs on a thread for each core, with their progress; the kernels release the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

# Yields the items of an iterable of known length, and shows the progress under a title.
Track = Callable[[Iterable[Any], int, str], Iterable[Any]]


def silent(items: Iterable[Any], total: int, title: str) -> Iterable[Any]:
    """Return the items unchanged and show nothing."""
    return items


def gather(
    function: Callable[[Job], Result], jobs: Sequence[Job], title: str, track: Track
) -> list[Result]:
    """Return the results of the jobs, in their order."""
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        try:
            return list(track(pool.map(function, jobs), len(jobs), title))
        except BaseException:
            # Or the pool would finish all other jobs, after a failure or Ctrl-C, before it ends.
            pool.shutdown(cancel_futures=True)
            raise
