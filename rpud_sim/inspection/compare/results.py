"""Results of a comparison of runs."""

from __future__ import annotations

from dataclasses import dataclass

from rpud_sim.inspection.compare.changes import Event, Setting
from rpud_sim.inspection.compare.estimates import (
    DIFFERS,
    TOO_FEW,
    UNDECIDED,
    Difference,
    Estimate,
)
from rpud_sim.inspection.compare.recorded_values import RecordedValues
from rpud_sim.inspection.compare.same_bits import DIFFERENT, EQUAL, TopicBits
from rpud_sim.inspection.compare.windows import Window
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.pages.quantities import Quantity


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

    quantity: str  # its name
    shown: Quantity  # how people read it
    unit: str  # SI unit
    runs: tuple[RunFigures | None, ...]  # figures of each run; None where a run has no values
    # of each run after the first from the first, for each tested figure
    differences: tuple[tuple[Difference, ...], ...]


@dataclass(frozen=True)
class WindowComparison:
    """Comparison of all quantities in one window."""

    window: Window
    quantities: tuple[QuantityComparison, ...]


@dataclass(frozen=True)
class Timing:
    """Timing of a run by its status: of the machine, not of the drill."""

    # greatest value of each field in ``quantities.TIMING``, by name; NaN if unknown
    greatest: dict[str, float]
    median: dict[str, float]  # median of the same
    # last value of each field in ``quantities.COUNTERS``; None if unknown
    counters: dict[str, int | None]


@dataclass(frozen=True)
class Comparison:
    """Result of ``compare``; the first run is the reference."""

    names: tuple[str, ...]  # short name of each run
    drills: tuple[RecordedDrill, ...]
    values: tuple[RecordedValues, ...]  # what was read of each
    parameters: tuple[Setting, ...]  # parameters, versions: that differ
    versions: tuple[Setting, ...]
    commands: tuple[Event, ...]
    faults: tuple[Event, ...]
    bits: tuple[tuple[TopicBits, ...], ...]  # of each run after the first, by topic
    windows: tuple[WindowComparison, ...]
    timing: tuple[Timing, ...]
    tolerance: float  # relative difference that does not matter; 0 for none
    warnings: tuple[str, ...]
    # Damaged parts that were skipped, by name of the run and of the part.
    damaged: dict[str, dict[str, str]]

    @property
    def differences(self) -> tuple[Difference, ...]:
        """All differences of all windows and runs."""
        return tuple(
            found
            for window in self.windows
            for quantity in window.quantities
            for run in quantity.differences
            for found in run
        )

    @property
    def equal_bits(self) -> bool:
        """Whether every compared message of every run is equal to that of the reference."""
        return all(
            any(topic.state == EQUAL for topic in run)
            and not any(topic.state == DIFFERENT for topic in run)
            for run in self.bits
        )

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
