"""Comparison of two runs in bags: their settings, their bits, and their distributions."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from itertools import chain
from typing import Any

import numpy as np

import rpud_sim.bag
from rpud_sim.foundation.quantities import ParameterError, check_names
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.compare.changes import (
    ComparedWindow,
    commands,
    faults,
    parameter_settings,
    version_settings,
    windows,
)
from rpud_sim.recorded.compare.estimates import (
    FigureDifference,
    decided,
    difference,
    estimate,
)
from rpud_sim.recorded.compare.results import Comparison, RunFigures
from rpud_sim.recorded.compare.same_bits import Compared, bits_of, bits_readers
from rpud_sim.recorded.compare.values import (
    FIGURES,
    MEAN,
    QUANTITIES,
    ComparedQuantity,
    OpenRun,
    RecordedValues,
    series_of,
    value_readers,
)
from rpud_sim.recorded.output import Damages
from rpud_sim.recorded.runs import RecordedRun, find_drill
from rpud_sim.recorded.streams import TopicStreams, read_together


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
    """Compare the second of two runs in bags with the first one.

    Args:
        paths: of two bags; one bag may be named twice for different runs in it.
        begin: simulation time from which on distributions are compared [s].
        end: simulation time up to which they are [s]; None for the end of the shorter run.
        settle: time that is left out after the start and after each command or fault [s].
        tolerance: accepted relative difference, such as 0.05; 0 for none.
        run_numbers: number of the run in each bag, or one for both; None for the first.
        namespaces: of the drill in each bag, or one for both; None where there is a single one.
        quantities: names of those to compare, as in ``values.QUANTITIES``; all if empty.
    """
    _check(paths, begin, end, settle, tolerance)
    wanted = _chosen(quantities)
    numbers = _for_each(run_numbers, "run")
    spaces = _for_each(namespaces, "namespace")
    with ExitStack() as opened:
        held = []
        for path, space, number in zip(paths, spaces, numbers, strict=True):
            bag = opened.enter_context(rpud_sim.bag.open(path))
            damages = Damages(bag)
            drill = find_drill(bag, damages, space, number)
            held.append(OpenRun(bag, drill, damages, TopicStreams(bag.batches)))
        runs = [RecordedValues(each.drill) for each in held]
        found: dict[str, Compared] = {}
        readers = [
            *(value_readers(*each, report) for each in zip(held, runs, strict=True)),
            bits_readers(held[0], held[1], found, report),
        ]
        read_together(chain(*readers))
        for each, run in zip(held, runs, strict=True):
            run.damaged = each.damages.texts
    bits = bits_of(found, min(run.end for run in runs))
    drills = [run.drill for run in runs]
    names = _names(drills)
    changed, failed = commands(drills), faults(runs)
    named = [*zip(names, runs, strict=True)]
    untimed = [f"{name}: no message shows its time" for name, run in named if not run.span]
    chosen, warnings = windows(runs, changed, failed, begin, end, settle)
    if untimed:
        chosen = ()
    elif not chosen:
        spans = (f"{name:.80} from {run.span}" for name, run in named)
        raise RecordingError(
            f"the runs have no time in common from {begin:g} s to "
            f"{'the end' if end is None else f'{end:g} s'}, after {settle:g} s to settle: "
            f"{', '.join(spans)}"
        )
    missing = (
        f"{name}: {run.missing_impacts} impacts are missing in the bag"
        for name, run in named
        if run.missing_impacts
    )
    told = (text for drill in drills for text in drill.warnings)
    return Comparison(
        names,
        tuple(runs),
        parameter_settings(drills),
        version_settings(drills),
        changed,
        failed,
        bits,
        chosen,
        *compare_values(runs, chosen, wanted, tolerance),
        tolerance,
        tuple(dict.fromkeys([*told, *untimed, *warnings, *missing])),
    )


def _check(
    paths: Sequence[object], begin: float, end: float | None, settle: float, tolerance: float
) -> None:
    if len(paths) != 2:
        raise ParameterError(f"{len(paths)} bags: two are compared; compare pairs one by one")
    for name, value in (("begin", begin), ("end", end), ("settle", settle)):
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(f"{name} = {value!r} s is outside its range [0, inf) s")
    if end is not None and end <= begin:
        raise ParameterError(f"end = {end:g} s is not after begin = {begin:g} s")
    if not (math.isfinite(tolerance) and 0.0 <= tolerance < 1.0):
        raise ParameterError(f"tolerance = {tolerance!r} is outside its range [0, 1)")


def _chosen(names: Sequence[str]) -> tuple[ComparedQuantity, ...]:
    known = {quantity.name: quantity for quantity in QUANTITIES}
    check_names(names, known, "quantity")
    return tuple(known[name] for name in dict.fromkeys(names)) if names else QUANTITIES


def _for_each(given: Sequence[Any], name: str) -> list[Any]:
    if len(given) > 2:
        raise ParameterError(f"{len(given)} choices of a {name} for 2 bags: give 1 or 2")
    return [*given] if len(given) == 2 else [given[0] if given else None] * 2


def _names(drills: Sequence[RecordedRun]) -> tuple[str, ...]:
    """Return a short name for each run, which no other has."""
    folders = [os.path.basename(os.path.abspath(drill.path)) for drill in drills]
    for names in (
        folders,
        [drill.path for drill in drills],
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
) -> tuple[tuple[dict[str, tuple[RunFigures | None, ...]], ...], tuple[FigureDifference, ...]]:
    """Return the figures of each window by quantity, and the differences of the second run."""
    figures: list[dict[str, tuple[RunFigures | None, ...]]] = []
    found: list[FigureDifference] = []
    for number, window in enumerate(windows):
        figures.append({})
        for quantity in quantities:
            series = [
                series_of(run, quantity, begin, end)
                for run, begin, end in zip(runs, window.begins, window.ends, strict=True)
            ]
            each = tuple(None if s is None else _figures(s, quantity) for s in series)
            if not any(each):  # no run has it
                continue
            figures[-1][quantity.name] = each
            first, other = each
            if first is None or other is None:
                continue
            equal = np.array_equal(*series)  # type: ignore[arg-type]
            for name in quantity.tested:
                pair = first.estimates[name], other.estimates[name]
                one = difference(quantity, name, *pair, tolerance, equal=equal)
                found.append(one._replace(window=number))
    return tuple(figures), decided(found, tolerance)


def _figures(values: np.ndarray, quantity: ComparedQuantity) -> RunFigures:
    names = (MEAN,) if quantity.averaged else FIGURES
    greatest = float(values.max()) if len(values) and not quantity.averaged else math.nan
    estimates = {name: estimate(values, name, quantity.resolution) for name in names}
    return RunFigures(len(values), greatest, estimates)
