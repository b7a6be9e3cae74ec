"""Comparison of two recorded runs: settings, bits and metrics, as JSON, as lines and as a page."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

from rpud_sim.bag.received_order import open_received
from rpud_sim.foundation.json_text import finite_values
from rpud_sim.foundation.quantities import ParameterError, check_names, counted
from rpud_sim.foundation.shown_quantities import NONE, ShownQuantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.compare.metrics import (
    COMPARED_QUANTITIES,
    DIFFERS,
    METRICS,
    TOO_FEW,
    UNDECIDED,
    MetricDifference,
    RecordedValues,
    differences,
    read_values,
)
from rpud_sim.recorded.compare.same_bits import DIFFERENT, EQUAL, TopicBits, compare_bits
from rpud_sim.recorded.output import SkippedParts
from rpud_sim.recorded.runs import RecordedRun, find_drill
from rpud_sim.simulation import PARAMETERS

_PERCENT = ShownQuantity("relative", "relative difference", "%", 100.0, floor=1e-5)
_SHOWN = {metric.quantity: metric.shown for metric in METRICS}


class Setting(NamedTuple):
    """Setting that differs: a parameter, the seed, a version, a command or a fault."""

    name: str
    unit: str  # of a parameter
    values: tuple[str, str]  # of each run, as text; empty where a run has none


@dataclass(frozen=True, repr=False)
class Comparison:
    """Result of ``compare``; the first run is the reference."""

    names: tuple[str, ...]  # short name of each run
    runs: tuple[RecordedValues, ...]  # what was read of each
    settings: tuple[Setting, ...]  # those that differ
    bits: tuple[TopicBits, ...]  # of the second run, by topic
    begin: float  # begin, end: simulation times between which metrics are compared [s]
    end: float
    metrics: tuple[MetricDifference, ...]
    tolerance: float  # accepted relative difference; 0 for none
    warnings: tuple[str, ...]
    damaged: dict[str, dict[str, str]]  # skipped parts, by name of the run and of the part

    def __repr__(self) -> str:
        return f"<Comparison of {' and '.join(self.names)}: {self.verdict}>"

    @property
    def equal_bits(self) -> bool:
        """Whether every compared message equals its counterpart in the reference."""
        states = {topic.state for topic in self.bits}
        return EQUAL in states and DIFFERENT not in states

    @property
    def differs(self) -> bool:
        """Whether a metric differs, beyond the tolerance if there is one."""
        return any(each.result == DIFFERS for each in self.metrics)

    @property
    def undecided(self) -> bool:
        """Whether nothing has an interval, or one reaches beyond a tolerance."""
        results = [each.result for each in self.metrics]
        open_ones = [each in (UNDECIDED, TOO_FEW) for each in results]
        return not self.equal_bits and (all(open_ones) or (self.tolerance > 0 and any(open_ones)))

    @property
    def verdict(self) -> str:
        """The result in one line."""
        count = len(self.metrics)
        percent = f"{100.0 * self.tolerance:g} %"
        if self.equal_bits:
            return "equal bits: the runs are the same"
        if self.differs:
            differing = sum(each.result == DIFFERS for each in self.metrics)
            beyond = f" by more than {percent}" if self.tolerance else ""
            return f"{differing} of {count} metrics differ{beyond}"
        if self.undecided:
            return "not decided: record longer runs"
        if self.tolerance:
            return f"all {count} metrics are within {percent}"
        return f"no difference found in {count} metrics"

    @property
    def bits_line(self) -> str:
        """Whether and where the bits differ first, in one line."""
        found = [topic for topic in self.bits if topic.state == DIFFERENT]
        if found:
            first = min(found, key=lambda topic: topic.time or 0.0)
            what = f"{first.field} " if first.field else ""
            return (
                f"bits differ from A from {first.time or 0.0:.9f} s on: {first.topic} {what}"
                f"is {first.other:.60}, in A {first.reference:.60}"
            )
        equal = [topic.messages for topic in self.bits if topic.state == EQUAL]
        if not equal:
            return "no bits to compare"
        return f"equal bits: all {sum(equal)} messages on {len(equal)} topics"

    @property
    def metric_rows(self) -> list[tuple[str, ...]]:
        """Rows for people, below ``METRIC_HEAD``."""
        return [_row(each) for each in self.metrics]

    def content(self) -> dict[str, Any]:
        """Return the comparison for JSON; ``docs/reference/compare.md`` lists its fields."""
        found: dict[str, Any] = finite_values(
            {
                "equal_bits": self.equal_bits,
                "differs": self.differs,
                "undecided": self.undecided,
                "tolerance": self.tolerance or None,
                "runs": [
                    {
                        "name": name,
                        "bag": run.drill.path,
                        "namespace": run.drill.namespace or "/",
                        "run": run.drill.number,
                        "runs_in_bag": run.drill.runs,
                        "journal": bool(run.drill.entries),
                        "begin": run.begin,
                        "end": run.end,
                        "impacts_missing": run.missing_impacts,
                    }
                    for name, run in zip(self.names, self.runs, strict=True)
                ],
                "settings": [each._asdict() for each in self.settings],
                "bits": [each._asdict() for each in self.bits],
                "begin": self.begin,
                "end": self.end,
                "metrics": [each._asdict() for each in self.metrics],
                "warnings": self.warnings,
                "damaged": self.damaged,
            }
        )
        return found


METRIC_HEAD = ("quantity", "metric", "A", "B", "difference, 95 % interval", "result")


def _row(each: MetricDifference) -> tuple[str, ...]:
    unit = _SHOWN[each.quantity]
    values = unit.text(each.reference), unit.text(each.other)
    low, high = each.low, each.high
    if math.isfinite(each.relative_low):
        unit, low, high = _PERCENT, each.relative_low, each.relative_high
    ends = unit.text(low, unit=False, sign=True), unit.text(high, sign=True)
    interval = NONE if NONE in ends else f"{ends[0]} to {ends[1]}"
    return _SHOWN[each.quantity].label, each.metric, *values, interval, each.result


def compare(
    paths: Sequence[str | os.PathLike[str]],
    *,
    begin: float = 0.5,
    end: float | None = None,
    tolerance: float = 0.0,
    run_numbers: Sequence[int | None] = (),
    namespaces: Sequence[str | None] = (),
    quantities: Sequence[str] = (),
    report: Callable[[int], object] = lambda messages: None,
) -> Comparison:
    """Compare the second of two runs in bags with the first one.

    Args:
        paths: of two bags; one bag may be named twice for different runs in it.
        begin: simulation time from which on metrics are compared [s].
        end: simulation time up to which they are [s]; None for the end of the shorter run.
        tolerance: accepted relative difference, such as 0.05; 0 for none.
        run_numbers: number of the run in each bag, or one for both; None for the first.
        namespaces: of the drill in each bag, or one for both; None where there is a single one.
        quantities: names of those to compare, such as ``peak_force``; all if empty.
        report: called with the number of messages that were read since the last call.
    """
    _check(paths, begin, end, tolerance, quantities)
    chosen = zip(
        paths, _for_both(namespaces, "namespace"), _for_both(run_numbers, "run"), strict=True
    )
    with ExitStack() as opened:
        held = []
        for path, space, number in chosen:
            bag = opened.enter_context(open_received(path))
            damages = SkippedParts(bag)
            held.append((bag, find_drill(bag, damages, space, number), damages))
        runs = [read_values(*each, report) for each in held]
        drills = [drill for _, drill, _ in held]
        bits = compare_bits([bag for bag, *_ in held], drills, min(run.end for run in runs), report)
    names = _names(drills)
    warnings = [text for drill in drills for text in drill.warnings]
    for name, run in zip(names, runs, strict=True):
        if not run.span:
            warnings.append(f"{name}: no message shows its time")
        if run.missing_impacts:
            warnings.append(f"{name}: missing in the bag: {counted(run.missing_impacts, 'impact')}")
    first = max([begin, *(run.begin for run in runs)])
    last = min([math.inf if end is None else end, *(run.end for run in runs)])
    timed = all(run.span for run in runs)
    if timed and not last > first:
        spans = ", ".join(f"{n:.80} from {run.span}" for n, run in zip(names, runs, strict=True))
        until = "the end" if end is None else f"{end:g} s"
        raise RecordingError(
            f"the runs have no time in common from {begin:g} s to {until}: {spans}"
        )
    return Comparison(
        names,
        tuple(runs),
        _settings(drills),
        bits,
        first,
        last,
        differences(runs, first, last, quantities or COMPARED_QUANTITIES, tolerance)
        if timed
        else (),
        tolerance,
        tuple(dict.fromkeys(warnings)),
        {n: each.texts for n, (*_, each) in zip(names, held, strict=True) if each.texts},
    )


def _check(
    paths: Sequence[object],
    begin: float,
    end: float | None,
    tolerance: float,
    quantities: Sequence[str],
) -> None:
    if len(paths) != 2:
        raise ParameterError(f"{len(paths)} bags: two are compared; compare pairs one by one")
    for name, value in (("begin", begin), ("end", end)):
        if value is not None and not (math.isfinite(value) and value >= 0.0):
            raise ParameterError(f"{name} = {value!r} s is outside its range [0, inf) s")
    if end is not None and end <= begin:
        raise ParameterError(f"end = {end:g} s is not after begin = {begin:g} s")
    if not (math.isfinite(tolerance) and 0.0 <= tolerance < 1.0):
        raise ParameterError(f"tolerance = {tolerance!r} is outside its range [0, 1)")
    check_names(quantities, COMPARED_QUANTITIES, "quantity")


def _for_both(given: Sequence[Any], name: str) -> list[Any]:
    if len(given) > 2:
        raise ParameterError(f"{len(given)} choices of a {name} for 2 bags: give 1 or 2")
    return [*given] if len(given) == 2 else [given[0] if given else None] * 2


def _names(drills: Sequence[RecordedRun]) -> tuple[str, ...]:
    """Return a short name for each run, which no other has."""
    folders = [os.path.basename(os.path.abspath(drill.path)) for drill in drills]
    whole = [f"{d.path} {d.namespace} run {d.number}" for d in drills]
    for names in (folders, [drill.path for drill in drills], whole):
        if len(set(names)) == len(names):
            return tuple(names)
    return tuple(f"{name} ({place})" for place, name in enumerate(folders, 1))


def _settings(drills: Sequence[RecordedRun]) -> tuple[Setting, ...]:
    """Return what differs in how two runs were made, and in what was done to them."""
    seeds = [{} if drill.seed is None else {"seed": drill.seed} for drill in drills]
    tables = [{**d.parameters, **seed} for d, seed in zip(drills, seeds, strict=True)]
    found = [*_differing(tables), *_differing([drill.versions for drill in drills])]
    one, other = (Counter(_changes(drill)) for drill in drills)
    alone = [(time, text, 0) for time, text in (one - other).elements()]
    alone += [(time, text, 1) for time, text in (other - one).elements()]
    for time, text, place in sorted(alone):
        at = f"at {time:.6f} s"
        found.append(Setting(text, "", ("", at) if place else (at, "")))
    return tuple(found)


def _differing(tables: Sequence[Mapping[str, Any]]) -> list[Setting]:
    found = []
    for name in sorted({str(name) for table in tables for name in table}):
        one, other = (_text(table[name]) if name in table else "" for table in tables)
        if one != other:
            declared = PARAMETERS.get(name)
            unit = getattr(declared.allowed, "unit", "") if declared else ""
            unit = "cycles" if name == "initial_phase" else unit
            found.append(Setting(name[:80], unit, (one, other)))
    return found


def _text(value: Any) -> str:
    """Return a value as text, numbers in full precision."""
    if isinstance(value, float):
        return f"{value:.12g}" if float(f"{value:.12g}") == value else repr(value)
    return f"{value!s:.200}"


def _changes(drill: RecordedRun) -> list[tuple[float, str]]:
    """Return simulation times [s] and texts of the commands and faults of a run."""
    found = []
    drawn = drill.beginning.get("faults")
    for fault in drawn if isinstance(drawn, list) else ():
        content = dict(fault) if isinstance(fault, Mapping) else {}
        time, kind = content.pop("onset", 0), content.pop("kind", "")
        found.append((_seconds(time), _words(f"fault {kind}", content)))
    parameters: Mapping[str, Any] = drill.parameters
    for entry in drill.commands:
        content = dict(entry.content)
        if entry.kind == "configure" and isinstance(content.get("parameters"), dict):
            after = content["parameters"]
            content = {k: v for k, v in after.items() if parameters.get(k) != v}
            parameters = {**parameters, **after}
        found.append((_seconds(entry.time), _words(entry.kind, content)))
    return found


def _seconds(time: Any) -> float:
    return time / SECOND if isinstance(time, int) else 0.0


def _words(kind: str, content: Mapping[str, Any]) -> str:
    parts = [f"{k} {_text(v)}" for k, v in content.items() if v not in (None, "")]
    return (f"{kind}: {', '.join(parts)}" if parts else kind)[:300]
