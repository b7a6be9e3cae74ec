"""Result of a comparison of runs, its content for JSON, and its tables for people."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from rpud_sim.foundation.json_text import finite_values
from rpud_sim.foundation.shown_quantities import NONE, ShownQuantity
from rpud_sim.recorded.compare.changes import AlignedEvent, ComparedWindow, Setting
from rpud_sim.recorded.compare.estimates import (
    DIFFERS,
    TOO_FEW,
    UNDECIDED,
    Estimate,
    FigureDifference,
)
from rpud_sim.recorded.compare.same_bits import DIFFERENT, EQUAL, TopicBits, first_different
from rpud_sim.recorded.compare.values import (
    FIGURES,
    MEAN,
    QUANTITIES,
    RecordedValues,
    shown,
)
from rpud_sim.recorded.runs import RecordedRun

LETTERS = "AB"  # of the runs; A is the reference
_PERCENT = ShownQuantity("relative", "relative difference", "%", 100.0, floor=1e-5)


class RunFigures(NamedTuple):
    """Figures of one quantity of one run in one window."""

    number: int  # of values
    # greatest value, NaN if it is averaged; it has no interval, for it grows with the length
    # of the run
    max: float
    # of mean, median and 95 % quantile, by their names; of a quantity that is averaged over
    # the time, of the mean alone
    estimates: dict[str, Estimate]


@dataclass(frozen=True, repr=False)
class Comparison:
    """Result of ``compare``; the first run is the reference."""

    names: tuple[str, ...]  # short name of each run
    values: tuple[RecordedValues, ...]  # what was read of each
    parameters: tuple[Setting, ...]  # parameters, versions: that differ
    versions: tuple[Setting, ...]
    commands: tuple[AlignedEvent, ...]
    faults: tuple[AlignedEvent, ...]
    bits: tuple[TopicBits, ...]  # of the second run, by topic
    windows: tuple[ComparedWindow, ...]
    # of each window, by quantity, of each run; None where a run has no values
    figures: tuple[dict[str, tuple[RunFigures | None, ...]], ...]
    differences: tuple[FigureDifference, ...]  # of all windows
    tolerance: float  # accepted relative difference; 0 for none
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<Comparison of {' and '.join(self.names)}: {self.verdict}>"

    @property
    def drills(self) -> tuple[RecordedRun, ...]:
        return tuple(run.drill for run in self.values)

    @property
    def damaged(self) -> dict[str, dict[str, str]]:
        """Damaged parts that were skipped, by name of the run and of the part."""
        runs = zip(self.names, self.values, strict=True)
        return {name: run.damaged for name, run in runs if run.damaged}

    @property
    def equal_bits(self) -> bool:
        """Whether every compared message is equal to that of the reference."""
        states = {topic.state for topic in self.bits}
        return EQUAL in states and DIFFERENT not in states

    @property
    def differs(self) -> bool:
        """Whether a figure differs, beyond the tolerance if there is one."""
        return any(found.decision == DIFFERS for found in self.differences)

    @property
    def undecided(self) -> bool:
        """Whether it is open: nothing could be tested, or an equivalence is not shown."""
        found = [each.decision for each in self.differences]
        if self.tolerance > 0.0:
            return not found or any(each in (UNDECIDED, TOO_FEW) for each in found)
        return all(each == TOO_FEW for each in found)

    @property
    def verdict(self) -> str:
        """The result in one line."""
        count = len(self.differences)
        differing = sum(each.decision == DIFFERS for each in self.differences)
        percent = f"{100.0 * self.tolerance:g} %"
        if self.equal_bits:
            return "equal bits: the runs are the same"
        if differing:
            beyond = f" by more than {percent}" if self.tolerance else ""
            return f"{differing} of {count} figures differ{beyond}"
        if self.undecided:
            reach = ", or an interval reaches beyond the tolerance" if self.tolerance else ""
            return f"not decided: too few values{reach}"
        if self.tolerance:
            return f"equivalent: all {count} figures are within {percent}"
        return f"no difference found in {count} figures"

    @property
    def sentence(self) -> str:
        """The result, and the greatest of the differences."""
        text = f"{self.verdict[0].upper()}{self.verdict[1:]}"
        known = [each for each in self.differences if math.isfinite(each.relative)]
        differing = [each for each in known if each.decision == DIFFERS]
        if not differing:
            return f"{text}."
        most = max(differing, key=lambda each: abs(math.log1p(each.relative)))
        *_, value, interval = texts(most)
        figure = "" if most.figure == MEAN else f" ({FIGURES[most.figure]})"
        segment = f" {self.windows[most.window].name}" if len(self.windows) > 1 else ""
        label = shown(most.quantity).label
        return f"{text}, most of all {label}{figure}{segment}: {value}, from {interval}."


def texts(each: FigureDifference) -> tuple[str, str, str, str]:
    """Return both figures, difference and interval: relative, if known, or in the unit."""
    unit = shown(each.quantity)
    figures = unit.text(each.reference), unit.text(each.other)
    value, low, high = each.difference, each.low, each.high
    if math.isfinite(each.relative):
        unit, value, low, high = _PERCENT, each.relative, each.relative_low, each.relative_high
    if math.isfinite(high - low) and high > low:  # digits far below the interval say nothing
        places = 2 - math.floor(math.log10(high - low))
        value, low, high = (round(each, places) for each in (value, low, high))
    interval = f"{unit.text(low, unit=False, sign=True)} to {unit.text(high, sign=True)}"
    return *figures, unit.text(value, sign=True), NONE if NONE in interval else interval


def content(found: Comparison) -> dict[str, Any]:
    """Return a comparison for JSON; ``docs/reference/compare.md`` lists its fields."""
    differences: dict[tuple[int, str], list[dict[str, Any]]] = {}
    for each in found.differences:
        names = ("difference", "low", "high", "relative", "relative_low", "relative_high", "p")
        plain = {name: getattr(each, name) for name in ("figure", *names, "decision")}
        differences.setdefault((each.window, each.quantity), []).append(plain)
    units = {quantity.name: quantity.unit for quantity in QUANTITIES}
    settings: dict[str, Any] = {
        name: [each._asdict() for each in getattr(found, name)]
        for name in ("parameters", "versions", "commands", "faults")
    }
    whole: dict[str, Any] = finite_values(
        {
            "equal_bits": found.equal_bits,
            "differs": found.differs,
            "undecided": found.undecided,
            "tolerance": found.tolerance or None,
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
                    "timing": run.timing,
                }
                for name, run in zip(found.names, found.values, strict=True)
            ],
            **settings,
            "bits": [[topic._asdict() for topic in found.bits]],
            "windows": [
                {
                    **window._asdict(),
                    "quantities": [
                        {
                            "quantity": name,
                            "unit": units[name],
                            "runs": [run and _plain(run) for run in runs],
                            "differences": [differences.get((number, name), [])],
                        }
                        for name, runs in found.figures[number].items()
                    ],
                }
                for number, window in enumerate(found.windows)
            ],
            "warnings": found.warnings,
            "damaged": found.damaged,
        }
    )
    return whole


def _plain(run: RunFigures) -> dict[str, Any]:
    figures = {name: {**each._asdict()} for name, each in run.estimates.items()}
    for each in figures.values():
        del each["number"]
    return {"count": run.number, "max": run.max, **figures}


class ResultTable(NamedTuple):
    """Table for people."""

    caption: str
    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


def setting_tables(found: Comparison) -> Iterator[ResultTable]:
    """Yield what differs in how the runs were made, and what was done to them, where any was."""
    for title, settings in (("parameter", found.parameters), ("version", found.versions)):
        rows = [(s.name, *(value or NONE for value in s.values), s.unit) for s in settings]
        yield ResultTable(f"{title}s that differ", (title, *LETTERS, "unit"), rows)
    for title, events in (("command", found.commands), ("fault", found.faults)):
        head = (title, *(f"{letter} [s]" for letter in LETTERS))
        rows = [(each.text, *map(_span, each.times, each.ends)) for each in events]
        yield ResultTable(f"{title}s of both runs", head, rows)


def _span(time: float | None, end: float | None) -> str:
    if time is None:
        return NONE
    return f"{time:.6f}" if end is None else f"{time:.6f} to {end:.6f}"


def figure_table(differences: Iterable[FigureDifference]) -> ResultTable:
    head = ("quantity", "figure", *LETTERS, "difference", "95 % interval", "decision")
    rows = [
        (
            shown(each.quantity).label,
            FIGURES[each.figure],
            *texts(each),
            each.decision if math.isnan(each.p) else f"{each.decision} (p = {each.p:.2g})",
        )
        for each in differences
    ]
    return ResultTable("Figures of both runs, and differences from A", head, rows)


def bits_line(run: tuple[TopicBits, ...]) -> str:
    """Return in one line whether the bits of a run are those of A."""
    if first := first_different(run):
        what = f"{first.field} " if first.field else ""
        return (
            f"bits differ from A from {first.time or 0.0:.9f} s on: {first.topic} {what}"
            f"is {first.other:.60}, in A {first.reference:.60}"
        )
    equal = [topic.messages for topic in run if topic.state == EQUAL]
    if not equal:
        return "no bits to compare"
    return f"equal bits: all {sum(equal)} messages on {len(equal)} topics"
