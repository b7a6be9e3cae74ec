"""Sweep: runs at many points of the parameters, as one pandas frame."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from multiprocessing.context import ForkServerContext, ForkServerProcess
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeAlias

from rpud_sim.foundation.extras import import_extra
from rpud_sim.foundation.options import POSITIVE_SECONDS
from rpud_sim.foundation.quantities import ParameterError, Quantity, short_repr
from rpud_sim.foundation.shown_quantities import METRIC_UNITS
from rpud_sim.scripting.runs import DrillRun, simulate
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.versions import engine_versions

if TYPE_CHECKING:
    import pandas

Points: TypeAlias = "Mapping[str, Any] | Sequence[Mapping[str, Any]] | pandas.DataFrame"

_SEEDS = Quantity("", "number of runs at each point", 1, 1e6, whole=True)
_TASK = 20.0  # simulated time of a task, about: long beside the way to a worker [s]
_TASKS = 64  # of a small sweep, so that several workers have work
_DELAY = 2.0  # until a terminal shows the progress [s]


def sweep(
    points: Points, duration: float, seeds: int | Sequence[int] = 1, executor: Any = None
) -> pandas.DataFrame:
    """Simulate the drill at many points, and return a frame with a row for each point and seed.

    A row has the point, the seed, the metrics of the run, and why it failed, if it did; then it has
    no metrics. ``frame.attrs["units"]`` has the units. The bits do not depend on the executor.

    Args:
        points: values by parameter, of which each combination is a point; or the points themselves,
            as mappings or as a frame. A point may hold what ``simulate`` takes, also ``faults``.
        duration: of each run [s].
        seeds: how many runs each point has, with seeds from 0 on; or their seeds.
        executor: whatever has ``submit``, such as a Dask client; by default a pool of processes.

    Raises:
        ParameterError: for a name or a value that cannot be used, before anything runs.
    """
    pandas = import_extra("pandas", "a sweep", "pandas")
    POSITIVE_SECONDS.check("duration", duration)
    rows = _rows(points)
    numbers = seeds if isinstance(seeds, Sequence) else range(int(_SEEDS.check("seeds", seeds)))
    places = [(number, seed) for number in range(len(rows)) for seed in numbers]
    if not places:
        raise ParameterError("points and seeds of a sweep: there are none")
    runs = [_run(number, rows[number], duration, seed) for number, seed in places]
    with _pool(runs) if executor is None else nullcontext(executor) as workers:
        found = list(_results(runs, workers))
    names = dict.fromkeys(itertools.chain(*rows, ["seed"], *(figures for figures, _ in found)))
    frame = pandas.DataFrame(
        [
            {**rows[number], "seed": seed, **figures}
            for (number, seed), (figures, _) in zip(places, found, strict=True)
        ],
        columns=list(names),
    )
    frame["failure"] = pandas.Series([reason for _, reason in found], dtype=object)
    frame.attrs["units"] = {name: unit_of(name) for name in frame}
    return frame


def unit_of(name: str) -> str:
    """Return the SI unit of a parameter or a figure; empty for one without a unit."""
    allowed = PARAMETERS[name].allowed if name in PARAMETERS else None
    return allowed.unit if isinstance(allowed, Quantity) else METRIC_UNITS.get(name, "")


def grid(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return each combination of values by name; the last one changes fastest."""
    listed = [
        [each] if isinstance(each, str | Mapping) or not hasattr(each, "__iter__") else [*each]
        for each in values.values()
    ]
    return [dict(zip(values, each, strict=True)) for each in itertools.product(*listed)]


def _rows(points: Points) -> list[dict[str, Any]]:
    if isinstance(points, Mapping):
        return grid(points)
    rows = points.to_dict("records") if hasattr(points, "to_dict") else points
    if not isinstance(rows, Sequence) or not all(isinstance(row, Mapping) for row in rows):
        raise ParameterError(
            f"points = {short_repr(points)} are not mappings of values by parameter"
        )
    return [dict(row) for row in rows]


def _run(number: int, point: Mapping[str, Any], duration: float, seed: int) -> DrillRun:
    try:
        if "seed" in point:
            raise ParameterError("seed is not a parameter of a point; seeds are an argument")
        return simulate(duration, seed=seed, **point)
    except ParameterError as error:
        raise ParameterError(f"point {number}: {error}") from None
    except TypeError:  # a name that is not a text, or an argument twice
        reason = f"point {number}: {short_repr(point)} is not what rpud_sim.simulate takes"
        raise ParameterError(reason) from None


Result = tuple[dict[str, float], str | None]  # metrics, and why there are none


def _results(runs: Sequence[DrillRun], executor: Any) -> Iterator[Result]:
    """Yield the results of runs in their order; a task that is lost costs its own runs alone."""
    from tqdm import tqdm

    size = max(1, min(int(_TASK / runs[0].duration), len(runs) // _TASKS))
    tasks = [runs[start : start + size] for start in range(0, len(runs), size)]
    futures = [executor.submit(_figures, task, engine_versions()) for task in tasks]
    try:
        # Without a terminal there is no bar.
        with tqdm(total=len(runs), unit=" runs", delay=_DELAY, disable=None, leave=False) as bar:
            for task, future in zip(tasks, futures, strict=True):
                try:
                    yield from future.result()
                except Exception as error:
                    yield from [({}, _reason(error))] * len(task)
                bar.update(len(task))
    finally:
        for future in futures:
            future.cancel()


def _figures(runs: Sequence[DrillRun], versions: Mapping[str, str]) -> list[Result]:
    """Return the results of runs, in a worker."""
    for name, version in engine_versions().items():
        if versions[name] != version:  # it would give other bits
            raise ValueError(f"the worker has {name} {version}, this machine {versions[name]}")
    found: list[Result] = []
    for run in runs:
        try:
            found.append(
                ({name: run.metrics[name] for name in METRIC_UNITS if name in run.metrics}, None)
            )
        except Exception as error:
            found.append(({}, _reason(error)))
    return found


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class _Worker(ForkServerProcess):
    """Process that does not import the caller's script, which would run the sweep once more."""

    def start(self) -> None:
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")  # what multiprocessing would import
        try:
            super().start()
        finally:
            sys.modules["__main__"] = script


class _Workers(ForkServerContext):
    Process = _Worker


@contextmanager
def _pool(runs: Sequence[DrillRun]) -> Iterator[ProcessPoolExecutor]:
    """Context with a process for each core; they end with this one."""
    compile_kernels(runs[0].plan.beginning.settings.configuration)  # once, or each would do it
    context = _Workers()  # a fork would copy locks of threads
    context.set_forkserver_preload([__name__])
    cores = min(len(os.sched_getaffinity(0)), len(runs))
    pool = ProcessPoolExecutor(cores, context, _begin_worker)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller handles Ctrl-C
    threading.Thread(target=_end_with_caller, daemon=True).start()


def _end_with_caller() -> None:
    """End this process when the caller has ended: its server lives as long as this process."""
    caller = multiprocessing.parent_process()
    assert caller is not None
    caller.join()
    os._exit(1)
