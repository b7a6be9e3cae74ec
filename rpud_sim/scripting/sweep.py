"""Sweep: runs at many points of the parameters, as one pandas frame."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from numbers import Real
from typing import TYPE_CHECKING, Any

from rpud_sim.foundation.child_process import end_with_parent
from rpud_sim.foundation.extras import import_extra
from rpud_sim.foundation.quantities import ParameterError, Quantity, shown
from rpud_sim.scripting.runs import DrillRun, simulate
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.simulation.versions import engine_versions

if TYPE_CHECKING:
    import pandas

    Points = Mapping[str, Any] | Sequence[Mapping[str, Any]] | pandas.DataFrame

_SEEDS = Quantity("", "number of runs at each point", 1, 1e6, whole=True)
_TASK = 20.0  # simulated time of a task, about: long beside the way to a worker [s]
_TASKS = 64  # of a small sweep, so that several workers have work
_DELAY = 2.0  # until a terminal shows the progress [s]
_UNITS = {**FIGURES, "duration": "s", "seed": "", "depth": "m", "penetration_rate": "m/s"}


def sweep(
    points: Points, duration: float, seeds: int | Sequence[int] = 1, executor: Any = None
) -> pandas.DataFrame:
    """Simulate the drill at many points, and return a frame with a row for each point and seed.

    A row has the point, the seed, the figures of the run, and why it failed, if it did; then it has
    no figures. ``frame.attrs["units"]`` has the units. The bits do not depend on the executor.

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
    rows = _rows(points)
    numbers = range(int(_SEEDS.check("seeds", seeds))) if isinstance(seeds, Real) else [*seeds]
    places = [(row, seed) for row in rows for seed in numbers]
    runs = [_run(number, row, duration, seed) for number, row in enumerate(rows) for seed in numbers]
    if executor is None and runs:
        with _pool(len(runs)) as executor:
            compile_kernels(runs[0].plan.beginning.settings.configuration)  # once, for all of them
            found = list(_results(runs, executor))
    else:
        found = list(_results(runs, executor))
    names = dict.fromkeys(itertools.chain(*rows))
    frame = pandas.DataFrame(
        [{**row, "seed": seed, **figures} for (row, seed), (figures, _) in zip(places, found)],
        columns=[*names, *dict.fromkeys(["seed", *itertools.chain(*(f for f, _ in found))])],
    )
    frame["failure"] = pandas.Series([reason for _, reason in found], dtype=object)
    frame.attrs["units"] = {name: unit_of(name) for name in frame}
    return frame


def unit_of(name: str) -> str:
    """Return the SI unit of a parameter or a figure; empty for one without a unit."""
    allowed = PARAMETERS[name].allowed if name in PARAMETERS else None
    return allowed.unit if isinstance(allowed, Quantity) else _UNITS.get(name, "")


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
        raise ParameterError(f"points = {shown(points)} are no mappings of values by parameter")
    return [dict(row) for row in rows]


def _run(number: int, point: Mapping[str, Any], duration: float, seed: int) -> DrillRun:
    try:
        if "seed" in point:
            raise ParameterError("seed is not a parameter of a point; seeds are an argument")
        return simulate(duration, seed=seed, **point)
    except ParameterError as error:
        raise ParameterError(f"point {number}: {error}") from None
    except TypeError:  # a name that is no text, or an argument twice
        reason = f"point {number}: {shown(point)} is not what rpud_sim.simulate takes"
        raise ParameterError(reason) from None


Result = tuple[dict[str, float], str | None]  # figures, and why there are none


def _results(runs: Sequence[DrillRun], executor: Any) -> Iterator[Result]:
    """Yield the results of runs in their order; a task that is lost costs its own runs alone."""
    from tqdm import tqdm

    size = max(1, min(int(_TASK / max(runs[0].duration, 1e-9)), len(runs) // _TASKS)) if runs else 1
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
            numbers = {n: each for n, each in run.figures.items() if not isinstance(each, dict)}
            found.append((numbers, None))
        except Exception as error:
            found.append(({}, _reason(error)))
    return found


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def _pool(most: int) -> Iterator[ProcessPoolExecutor]:
    """Context with a process for each core, which ends with this one."""
    context = multiprocessing.get_context("forkserver")  # a fork would copy locks of threads
    context.set_forkserver_preload([__name__])
    cores = min(len(os.sched_getaffinity(0)), most)
    pool = ProcessPoolExecutor(cores, context, _begin_worker)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that was called handles Ctrl-C
    end_with_parent()
