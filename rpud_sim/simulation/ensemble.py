"""Ensembles of runs, such as over initial vibration phases, as fast as the machine allows."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.compile import compilation_reported
from rpud_sim.model.elementary import CALLED_BY_PYTHON
from rpud_sim.model.engine import Buffers, EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration, Settings, with_defaults
from rpud_sim.simulation.metrics import Metrics, RecentEnergy, Values
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.sampling import Times

_TASK = 10 * SECOND  # simulated time of a thread's task, at least [ns]


@dataclasses.dataclass(frozen=True)
class Member:
    """Result of one member of an ensemble."""

    metrics: Metrics  # metrics of the whole run, or of the part before it failed
    failure: EngineError | None = None  # why it failed; None if it did not


class _StoppedError(Exception):
    """The other members are not wanted any more."""


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Runs of one drill from several initial phases."""

    members: tuple[Member, ...]  # at least one; all have the same metrics
    real_time_factor: float  # simulated seconds over wall seconds, over all members

    def mean(self) -> dict[str, Any]:
        """Return the mean of ``Metrics.to_dict``; None where no member has a value."""
        return _mean([member.metrics.to_dict() for member in self.members])

    def standard_error(self) -> Values:
        """Return the standard error of each mean; None for fewer than two members."""
        found: Values = {}
        columns = [member.metrics.to_dict() for member in self.members]
        for name, first in columns[0].items():
            if name == "duration" or isinstance(first, dict):
                continue
            column = [each[name] for each in columns if each[name] is not None]
            spread = float(np.std(column, ddof=1)) if column[1:] else None
            found[name] = None if spread is None else spread / math.sqrt(len(column))
        return found


def _mean(values: list[Any]) -> Any:
    """Return the mean of numbers, or of dictionaries of them by name."""
    if isinstance(values[0], dict):
        return {name: _mean([each[name] for each in values]) for name in values[0]}
    numbers = [value for value in values if value is not None]
    return float(np.mean(numbers)) if len(numbers) > 1 else next(iter(numbers), None)


def compile_kernels(
    configuration: Configuration | Parameters,
    report: Callable[[str], object] = lambda text: None,
    messages: bool = False,
) -> None:
    """Compile every kernel, or load it from the cache, before anything is timed.

    ``report`` is called in another thread with a line of text, if it takes long; ``messages``:
    also the kernels that make messages in batches.
    """
    with compilation_reported(report):
        for function, arguments in CALLED_BY_PYTHON:
            function(*arguments)
        metrics = Metrics()

        def add(block: Block) -> None:
            metrics.add(block)
            block.sample(Times.from_nanoseconds(block.start))

        settings = Settings(with_defaults(configuration))
        run = Run(Plan(Beginning(settings)), wanted=None, on_block=add)
        run.finish(1000)
        metrics.values()
        if not settings.configuration.has_feed:  # whose steps change the weight on bit
            run.apply(WeightOnBit(0.5 * run.simulation.applied.weight_on_bit.force + 1.0))
        run.finish(2000)  # the engine gets changes when time continues
        if messages:
            energy = RecentEnergy()
            energy.add(run.simulation.advance_through(np.array([3000, 4000])))
            energy.powers()


def run_members(
    plans: Sequence[Plan],
    duration: float,
    report: Callable[[float], object] = lambda simulated: None,
    threads: int = 1,
) -> Generator[Member, None, None]:
    """Yield the result of one run per plan, failed ones as well; each lasts a duration [s].

    ``report`` is called now and then with the simulated seconds since the last call, in any
    thread. The compiled code needs no GIL, so members run on ``threads``. A change that cannot be
    carried out raises a ChangeError.
    """
    end = round(duration * SECOND)
    size = max(_TASK // max(end, 1), 1)
    tasks = [plans[i : i + size] for i in range(0, len(plans), size)]
    lock, stopped, buffers = threading.Lock(), threading.Event(), Buffers()

    def advanced(simulated: float) -> None:
        if stopped.is_set():
            raise _StoppedError
        with lock:
            report(simulated)

    def run(task: Sequence[Plan]) -> list[Member]:
        return [_run(plan, end, buffers, advanced) for plan in task]

    if threads == 1 or len(tasks) == 1:
        for task in tasks:
            yield from run(task)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            for future in [pool.submit(run, task) for task in tasks]:
                yield from future.result()
        finally:
            # Or the pool would finish all other members, after a failure or Ctrl-C, before it ends.
            stopped.set()
            pool.shutdown(cancel_futures=True)


def _run(plan: Plan, end: int, buffers: Buffers, report: Callable[[float], object]) -> Member:
    metrics = Metrics()

    def add(block: Block) -> None:
        metrics.add(block)
        report((block.end - block.start) / SECOND)

    try:
        Run(plan, wanted=None, on_block=add, buffers=buffers).finish(end)
    except EngineError as error:
        return Member(metrics, error)
    return Member(metrics)


def run_ensemble(
    plans: Sequence[Plan],
    duration: float,
    report: Callable[[float], object] = lambda simulated: None,
    threads: int = 1,
) -> Ensemble:
    """Run plans of one configuration; arguments as for ``run_members``. A failure is raised."""
    compile_kernels(plans[0].beginning.settings.configuration)
    started = time.perf_counter()
    members: list[Member] = []
    with contextlib.closing(run_members(plans, duration, report, threads)) as found:
        for member in found:
            if member.failure is not None:
                raise member.failure
            members.append(member)
    wall = time.perf_counter() - started
    simulated = round(duration * SECOND) / SECOND * len(members)
    return Ensemble(tuple(members), simulated / wall if wall > 0.0 else math.inf)


def phases_of(plan: Plan, repeat: int) -> tuple[Plan, ...]:
    """Return the plans of an ensemble: one from other initial phases, drawn with its seed."""
    beginning = plan.beginning
    if repeat == 1:
        return (plan,)
    phases = initial_phases(repeat, beginning.settings.seed_or_none)
    return tuple(
        dataclasses.replace(plan, beginning=dataclasses.replace(beginning, initial_phase=phase))
        for phase in phases
    )
