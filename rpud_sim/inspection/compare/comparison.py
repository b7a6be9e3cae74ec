"""Comparing runs in bags: their settings, their bits, and the distributions of what they did."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

import rpud_sim.bag
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown_name
from rpud_sim.inspection import InspectionError
from rpud_sim.inspection.compare.changes import (
    ComparedWindow,
    commands,
    faults,
    parameter_settings,
    version_settings,
    windows,
)
from rpud_sim.inspection.compare.estimates import (
    FigureDifference,
    corrected,
    decide,
    difference,
    estimate,
)
from rpud_sim.inspection.compare.results import (
    Comparison,
    QuantityComparison,
    RunFigures,
    Timing,
    WindowComparison,
    all_differences,
)
from rpud_sim.inspection.compare.same_bits import Side, read_side_by_side
from rpud_sim.inspection.compare.values import (
    COUNTERS,
    MEAN,
    MEDIAN,
    P95,
    QUANTITIES,
    STATUS,
    TIMING,
    ComparedQuantity,
    RecordedValues,
    series_of,
)
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
        quantities: names of those to compare, as in ``values.QUANTITIES``; all if empty.
    """
    _check(paths, begin, end, settle, tolerance)
    wanted = _chosen(quantities)
    numbers = _for_each(run_numbers, len(paths), "run")
    spaces = _for_each(namespaces, len(paths), "namespace")
    with ExitStack() as opened:
        sides = []
        for path, space, number in zip(paths, spaces, numbers, strict=True):
            bag = opened.enter_context(rpud_sim.bag.open(path))
            damages = Damages(bag)
            sides.append(Side(bag, find_drill(bag, damages, space, number), damages))
        bits = tuple(read_side_by_side(sides, report))
    runs = [side.values for side in sides]
    drills = [run.drill for run in runs]
    names = _names(drills)
    changed, failed = commands(drills), faults(runs)
    chosen, warnings = windows(runs, changed, failed, begin, end, settle)
    if not chosen:
        spans = ", ".join(
            f"{name:.80} from {run.begin:.6g} to {run.end:.6g} s"
            for name, run in zip(names, runs, strict=True)
        )
        raise InspectionError(
            f"the runs have no time in common from {begin:g} s to "
            f"{'the end' if end is None else f'{end:g} s'}, after {settle:g} s to settle: {spans}"
        )
    missing = [
        f"{name}: {run.missing_impacts} impacts are missing in the bag"
        for name, run in zip(names, runs, strict=True)
        if run.missing_impacts
    ]
    told = (text for drill in drills for text in drill.warnings)
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
        tuple(dict.fromkeys([*told, *warnings, *missing])),
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


def _chosen(names: Sequence[str]) -> tuple[ComparedQuantity, ...]:
    known = {quantity.name: quantity for quantity in QUANTITIES}
    for name in names:
        if name not in known:
            raise ParameterError(
                f"{shown_name(name)} is not a quantity; {did_you_mean(name, known)}"
            )
    return tuple(known[name] for name in dict.fromkeys(names)) if names else QUANTITIES


def _for_each(given: Sequence[Any], count: int, name: str) -> list[Any]:
    if len(given) not in (0, 1, count):
        raise ParameterError(
            f"{len(given)} choices of a {name} for {count} bags: give 1 or {count}"
        )
    return [*given] if len(given) == count else [given[0] if given else None] * count


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


def compare_values(
    runs: Sequence[RecordedValues],
    windows: Sequence[ComparedWindow],
    quantities: Sequence[ComparedQuantity] = QUANTITIES,
    tolerance: float = 0.0,
) -> tuple[WindowComparison, ...]:
    """Return the comparison of each window, with decisions corrected for their number."""
    found = []
    for window in windows:
        each = (_compare_quantity(runs, window, quantity, tolerance) for quantity in quantities)
        found.append(WindowComparison(**vars(window), quantities=tuple(filter(None, each))))
    chances = corrected([each.chance for each in all_differences(found)])
    decided = (
        replace(each, chance=chance, decision=decide(each, chance, tolerance))
        for each, chance in zip(all_differences(found), chances, strict=True)
    )
    return tuple(
        replace(window, quantities=tuple(_with(q, decided) for q in window.quantities))
        for window in found
    )


def _with(quantity: QuantityComparison, decided: Iterator[FigureDifference]) -> QuantityComparison:
    runs = quantity.differences
    return replace(quantity, differences=tuple(tuple(next(decided) for _ in run) for run in runs))


def _compare_quantity(
    runs: Sequence[RecordedValues],
    window: ComparedWindow,
    quantity: ComparedQuantity,
    tolerance: float,
) -> QuantityComparison | None:
    """Return the comparison of a quantity; None if no run has it."""
    series = [
        series_of(run, quantity, begin, end)
        for run, begin, end in zip(runs, window.begins, window.ends, strict=True)
    ]
    figures = tuple(None if values is None else _figures(values, quantity) for values in series)
    if not any(figures):
        return None
    first, reference = series[0], figures[0]
    differences: list[tuple[FigureDifference, ...]] = []
    for values, other in zip(series[1:], figures[1:], strict=True):
        if first is None or values is None or reference is None or other is None:
            differences.append(())
            continue
        equal = np.array_equal(first, values)
        differences.append(
            tuple(
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
        )
    return QuantityComparison(quantity, figures, tuple(differences))


def _figures(values: np.ndarray, quantity: ComparedQuantity) -> RunFigures:
    names = (MEAN,) if quantity.averaged else (MEAN, MEDIAN, P95)
    greatest = float(values.max()) if len(values) and not quantity.averaged else math.nan
    estimates = {name: estimate(values, name, quantity.resolution) for name in names}
    return RunFigures(estimates, greatest, len(values))


def _timing(run: RecordedValues) -> Timing:
    arrays = run.topics.get(STATUS, {})
    held = {name: arrays.get(name, np.empty(0)) for name, *_ in (*TIMING, *COUNTERS)}
    known = {name: values[np.isfinite(values)] for name, values in held.items()}
    timed = {name: known[name] if len(known[name]) else np.full(1, np.nan) for name, *_ in TIMING}
    return Timing(
        {name: float(values.max()) for name, values in timed.items()},
        {name: float(np.median(values)) for name, values in timed.items()},
        {name: int(known[name][-1]) if len(known[name]) else None for name, _ in COUNTERS},
    )
