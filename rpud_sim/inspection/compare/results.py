"""Results of a comparison of runs, and their content for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rpud_sim.foundation.json_values import finite_values
from rpud_sim.inspection.compare.changes import AlignedEvent, ComparedWindow, Setting
from rpud_sim.inspection.compare.estimates import (
    DIFFERS,
    TOO_FEW,
    UNDECIDED,
    Estimate,
    FigureDifference,
)
from rpud_sim.inspection.compare.same_bits import DIFFERENT, EQUAL, TopicBits
from rpud_sim.inspection.compare.values import FIGURES, MEAN, ComparedQuantity, RecordedValues
from rpud_sim.inspection.recorded_drill import RecordedDrill

_LETTERS = "ABCDEF"


@dataclass(frozen=True)
class RunFigures:
    """Figures of one quantity of one run in one window."""

    # of mean, median and 95 % quantile, by their names; of a quantity that is averaged over
    # the time, of the mean alone
    estimates: dict[str, Estimate]
    # greatest value, NaN if it is averaged; it has no interval, for it grows with the length
    # of the run
    greatest: float
    count: int  # number of values


@dataclass(frozen=True)
class QuantityComparison:
    """Comparison of one quantity in one window."""

    compared: ComparedQuantity
    runs: tuple[RunFigures | None, ...]  # figures of each run; None where a run has no values
    # of each run after the first from the first, for each tested figure
    differences: tuple[tuple[FigureDifference, ...], ...]

    @property
    def quantity(self) -> str:
        """Name of the quantity."""
        return self.compared.name


@dataclass(frozen=True)
class WindowComparison(ComparedWindow):
    """Comparison of all quantities in one window."""

    quantities: tuple[QuantityComparison, ...]


@dataclass(frozen=True)
class Timing:
    """Timing of a run by its status: of the machine, not of the drill."""

    # greatest value of each field in ``values.TIMING``, by name; NaN if unknown
    greatest: dict[str, float]
    median: dict[str, float]  # median of the same
    # last value of each field in ``values.COUNTERS``; None if unknown
    counters: dict[str, int | None]


@dataclass(frozen=True)
class Comparison:
    """Result of ``compare``; the first run is the reference."""

    names: tuple[str, ...]  # short name of each run
    drills: tuple[RecordedDrill, ...]
    values: tuple[RecordedValues, ...]  # what was read of each
    parameters: tuple[Setting, ...]  # parameters, versions: that differ
    versions: tuple[Setting, ...]
    commands: tuple[AlignedEvent, ...]
    faults: tuple[AlignedEvent, ...]
    bits: tuple[tuple[TopicBits, ...], ...]  # of each run after the first, by topic
    windows: tuple[WindowComparison, ...]
    timing: tuple[Timing, ...]
    tolerance: float  # relative difference that does not matter; 0 for none
    warnings: tuple[str, ...]

    @property
    def letters(self) -> str:
        """Letter of each run; A is the reference."""
        return _LETTERS[: len(self.names)]

    @property
    def damaged(self) -> dict[str, dict[str, str]]:
        """Damaged parts that were skipped, by name of the run and of the part."""
        runs = zip(self.names, self.values, strict=True)
        return {name: run.damaged for name, run in runs if run.damaged}

    @property
    def differences(self) -> tuple[FigureDifference, ...]:
        """All differences of all windows and runs."""
        return tuple(all_differences(self.windows))

    @property
    def equal_bits(self) -> bool:
        """Whether every compared message of every run is equal to that of the reference."""
        states = [{topic.state for topic in run} for run in self.bits]
        return all(EQUAL in run and DIFFERENT not in run for run in states)

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
        differing = [
            (each, window.name)
            for window in self.windows
            for quantity in window.quantities
            for run in quantity.differences
            for each in run
            if each.decision == DIFFERS and math.isfinite(each.relative)
        ]
        if not differing:
            return f"{text}."
        most, where = max(differing, key=lambda pair: abs(math.log1p(pair[0].relative)))
        _, _, value, interval = most.texts
        label = most.compared.shown.label
        figure = "" if most.figure == MEAN else f" ({FIGURES[most.figure]})"
        segment = f" {where}" if len(self.windows) > 1 else ""
        return f"{text}, most of all {label}{figure}{segment}: {value}, from {interval}."


def all_differences(found: Sequence[WindowComparison]) -> Iterator[FigureDifference]:
    """Yield the differences of all windows and runs."""
    for window in found:
        for quantity in window.quantities:
            for run in quantity.differences:
                yield from run


def content(found: Comparison) -> dict[str, Any]:
    """Return a comparison for JSON; ``docs/reference/compare.md`` lists its fields."""
    runs = zip(found.names, found.drills, found.values, found.timing, strict=True)
    plain: dict[str, Any] = finite_values(
        {
            "equal_bits": found.equal_bits,
            "differs": found.differs,
            "undecided": found.undecided,
            "tolerance": found.tolerance or None,
            "runs": [
                {
                    "name": name,
                    "bag": drill.path,
                    "namespace": drill.namespace or "/",
                    "run": drill.number,
                    "runs_in_bag": drill.runs,
                    "journal": bool(drill.entries),
                    "begin": values.begin,
                    "end": values.end,
                    "impacts_missing": values.missing_impacts,
                    "timing": {
                        "greatest": timing.greatest,
                        "median": timing.median,
                        **timing.counters,
                    },
                }
                for name, drill, values, timing in runs
            ],
            "parameters": [asdict(each) for each in found.parameters],
            "versions": [asdict(each) for each in found.versions],
            "commands": [asdict(each) for each in found.commands],
            "faults": [asdict(each) for each in found.faults],
            "bits": [[asdict(topic) for topic in run] for run in found.bits],
            "windows": [
                {**vars(each), "quantities": [*map(_quantity, each.quantities)]}
                for each in found.windows
            ],
            "warnings": found.warnings,
            "damaged": found.damaged,
        }
    )
    return plain


def _quantity(each: QuantityComparison) -> dict[str, Any]:
    return {
        "quantity": each.quantity,
        "unit": each.compared.unit,
        "runs": [
            run
            and {
                "count": run.count,
                "max": run.greatest,
                **{name: _estimate(figure) for name, figure in run.estimates.items()},
            }
            for run in each.runs
        ],
        "differences": [[_difference(found) for found in run] for run in each.differences],
    }


def _estimate(each: Estimate) -> dict[str, float]:
    return {name: getattr(each, name) for name in ("value", "low", "high", "error", "blocks")}


def _difference(each: FigureDifference) -> dict[str, Any]:
    relative = ("relative", "relative_low", "relative_high")
    return {
        "figure": each.figure,
        "difference": each.value,
        "low": each.low,
        "high": each.high,
        **{name: getattr(each, name) for name in relative},
        "p": each.chance,
        "decision": each.decision,
    }
