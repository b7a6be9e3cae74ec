"""Comparing runs in bags: their settings, their bits, and the distributions of what they did."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagReader
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown_name
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.compare.changes import (
    commands,
    faults,
    parameter_settings,
    version_settings,
)
from rpud_sim.inspection.compare.estimates import (
    Difference,
    corrected,
    decide,
    difference,
    estimate,
)
from rpud_sim.inspection.compare.quantities import (
    COUNTERS,
    MEAN,
    MEDIAN,
    P95,
    QUANTITIES,
    TIMING,
    Quantity,
)
from rpud_sim.inspection.compare.quantities import STATUS as STATUS_TOPIC
from rpud_sim.inspection.compare.recorded_values import RecordedValues, read_values, series_of
from rpud_sim.inspection.compare.results import (
    Comparison,
    QuantityComparison,
    RunFigures,
    Timing,
    WindowComparison,
)
from rpud_sim.inspection.compare.same_bits import (
    Side,
    compare_bits,
)
from rpud_sim.inspection.compare.windows import Choice, Window, windows
from rpud_sim.inspection.output import Damages
from rpud_sim.inspection.recorded_drill import RecordedDrill, find_drill

MOST_RUNS = 6  # number of runs that are compared with each other


def compare(
    paths: Sequence[str | os.PathLike[str]],
    *,
    begin: float = 0.0,
    end: float | None = None,
    settle: float = 0.5,
    tolerance: float = 0.0,
    run_numbers: Sequence[int | None] = (),
    namespaces: Sequence[str | None] = (),
    quantities: Sequence[str] = (),
    report: Callable[[int], object] = lambda messages: None,
) -> Comparison:
    """Compare runs in bags with the first one.

    Args:
        paths: of two to six bags; one bag may be named several times for different runs in it.
        begin: simulation time from which on distributions are compared [s].
        end: simulation time up to which they are [s]; None for the end of the shortest run.
        settle: time that is left out after the start and after each command or fault [s].
        tolerance: relative difference that does not matter, such as 0.05; 0 for none.
        run_numbers: number of the run in each bag, or one for all; None for the first.
        namespaces: of the drill in each bag, or one for all; None where there is a single one.
        quantities: names of those to compare, as in ``quantities.QUANTITIES``; all if empty.
    """
    _check(paths, begin, end, settle, tolerance)
    wanted = _chosen(quantities)
    numbers = _for_each(run_numbers, len(paths), "run")
    spaces = _for_each(namespaces, len(paths), "namespace")
    with ExitStack() as opened:
        bags = [opened.enter_context(rpud_sim.bag.open(path)) for path in paths]
        runs = [
            _read(bag, space, number, report)
            for bag, space, number in zip(bags, spaces, numbers, strict=True)
        ]
        drills = [run.drill for run in runs]
        sides = [Side(bag, drill) for bag, drill in zip(bags, drills, strict=True)]
        bits = tuple(compare_bits(sides[0], side, report) for side in sides[1:])
    names = _names(drills)
    changed, failed = commands(drills), faults(runs)
    chosen, warnings = windows(runs, changed, failed, Choice(begin, end, settle))
    if not chosen:
        raise InspectionError(_no_time(names, runs, begin, end, settle))
    warnings = [
        *(text for drill in drills for text in drill.warnings),
        *warnings,
        *(
            f"{name}: {run.missing_impacts} impacts are missing in the bag"
            for name, run in zip(names, runs, strict=True)
            if run.missing_impacts
        ),
    ]
    return Comparison(
        names,
        tuple(drills),
        tuple(runs),
        parameter_settings(drills),
        version_settings(drills),
        changed,
        failed,
        bits,
        compare_values(runs, chosen, wanted, tolerance),
        tuple(_timing(run) for run in runs),
        tolerance,
        tuple(dict.fromkeys(warnings)),
        {name: run.damaged for name, run in zip(names, runs, strict=True) if run.damaged},
    )


def _check(
    paths: Sequence[object], begin: float, end: float | None, settle: float, tolerance: float
) -> None:
    if not 2 <= len(paths) <= MOST_RUNS:
        raise ParameterError(f"{len(paths)} bags are outside the range [2, {MOST_RUNS}]")
    for name, value in (("begin", begin), ("end", end), ("settle", settle)):
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(f"{name} = {value!r} s is outside its range [0, inf) s")
    if end is not None and end <= begin:
        raise ParameterError(f"end = {end:g} s is not after begin = {begin:g} s")
    if not (math.isfinite(tolerance) and 0.0 <= tolerance < 1.0):
        raise ParameterError(f"tolerance = {tolerance!r} is outside its range [0, 1)")


def _chosen(names: Sequence[str]) -> tuple[Quantity, ...]:
    known = {quantity.name: quantity for quantity in QUANTITIES}
    for name in names:
        if name not in known:
            raise ParameterError(
                f"{shown_name(name)} is not a quantity; {did_you_mean(name, known)}"
            )
    return tuple(known[name] for name in dict.fromkeys(names)) if names else QUANTITIES


def _for_each(given: Sequence, count: int, name: str) -> list:
    if len(given) not in (0, 1, count):
        raise ParameterError(
            f"{len(given)} choices of a {name} for {count} bags: give 1 or {count}"
        )
    return [*given] if len(given) == count else [given[0] if given else None] * count


def _read(
    bag: BagReader, namespace: str | None, number: int | None, report: Callable[[int], object]
) -> RecordedValues:
    damages = Damages(bag)
    return read_values(bag, find_drill(bag, damages, namespace, number), damages, report)


def _names(drills: Sequence[RecordedDrill]) -> tuple[str, ...]:
    """Return a short name for each run, which no other has."""
    folders = [os.path.basename(os.path.abspath(drill.path)) for drill in drills]
    for names in (
        folders,
        [drill.path for drill in drills],
        [f"{d.path} {d.namespace}" for d in drills],
        [f"{d.path} {d.namespace} run {d.number}" for d in drills],
    ):
        if len(set(names)) == len(names):
            return tuple(names)
    return tuple(f"{name} ({place})" for place, name in enumerate(folders, 1))


def _no_time(
    names: Sequence[str],
    runs: Sequence[RecordedValues],
    begin: float,
    end: float | None,
    settle: float,
) -> str:
    spans = ", ".join(
        f"{name:.80} from {run.begin:.6g} to {run.end:.6g} s"
        for name, run in zip(names, runs, strict=True)
    )
    last = "the end" if end is None else f"{end:g} s"
    return (
        f"the runs have no time in common from {begin:g} s to {last}, after {settle:g} s to "
        f"settle: {spans}"
    )


def compare_values(
    runs: Sequence[RecordedValues],
    windows: Sequence[Window],
    quantities: Sequence[Quantity] = QUANTITIES,
    tolerance: float = 0.0,
) -> tuple[WindowComparison, ...]:
    found = [_compare_window(runs, window, quantities, tolerance) for window in windows]
    return _decided(found, tolerance)


def _compare_window(
    runs: Sequence[RecordedValues],
    window: Window,
    quantities: Sequence[Quantity],
    tolerance: float,
) -> WindowComparison:
    found = []
    for quantity in quantities:
        series = [
            series_of(run, quantity.name, begin, end)
            for run, begin, end in zip(runs, window.begins, window.ends, strict=True)
        ]
        figures = tuple(None if values is None else _figures(values, quantity) for values in series)
        if all(each is None for each in figures):
            continue
        differences = tuple(
            _differences(quantity, (series[0], values), (figures[0], other), tolerance)
            for values, other in zip(series[1:], figures[1:], strict=True)
        )
        found.append(
            QuantityComparison(quantity.name, quantity.shown, quantity.unit, figures, differences)
        )
    return WindowComparison(window, tuple(found))


def _differences(
    quantity: Quantity,
    series: tuple[np.ndarray | None, np.ndarray | None],
    figures: tuple[RunFigures | None, RunFigures | None],
    tolerance: float,
) -> tuple[Difference, ...]:
    """Return the differences of two runs in one quantity; none if a run does not have it."""
    (first, second), (reference, other) = series, figures
    if first is None or second is None or reference is None or other is None:
        return ()
    equal = np.array_equal(first, second)
    return tuple(
        difference(
            quantity,
            name,
            reference.estimates[name],
            other.estimates[name],
            tolerance,
            equal=equal,
        )
        for name in quantity.tested
    )


def _figures(values: np.ndarray, quantity: Quantity) -> RunFigures:
    names = (MEAN,) if quantity.averaged else (MEAN, MEDIAN, P95)
    greatest = float(values.max()) if len(values) and not quantity.averaged else math.nan
    estimates = {name: estimate(values, name, quantity.resolution) for name in names}
    return RunFigures(estimates, greatest, len(values))


def _decided(found: Sequence[WindowComparison], tolerance: float) -> tuple[WindowComparison, ...]:
    chances = [
        each.chance for window in found for q in window.quantities for run in q.differences
        for each in run
    ]  # fmt: skip
    left = iter(corrected(chances))

    def settled(each: Difference) -> Difference:
        chance = next(left)
        return replace(each, chance=chance, decision=decide(each, chance, tolerance))

    return tuple(
        replace(
            window,
            quantities=tuple(
                replace(
                    q, differences=tuple(tuple(settled(d) for d in run) for run in q.differences)
                )
                for q in window.quantities
            ),
        )
        for window in found
    )


def _timing(run: RecordedValues) -> Timing:
    arrays = run.topics.get(STATUS_TOPIC, {})

    def finite(name: str) -> np.ndarray:
        values = arrays.get(name, np.empty(0))
        return values[np.isfinite(values)]

    held = {name: finite(name) for name, *_ in (*TIMING, *COUNTERS)}
    return Timing(
        {name: float(held[name].max()) if len(held[name]) else math.nan for name, *_ in TIMING},
        {
            name: float(np.median(held[name])) if len(held[name]) else math.nan
            for name, *_ in TIMING
        },
        {name: int(held[name][-1]) if len(held[name]) else None for name, _ in COUNTERS},
    )
