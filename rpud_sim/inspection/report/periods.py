"""Statistics of a drill between its commands and faults, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from rpud_sim.inspection.report.changes import Change
from rpud_sim.inspection.report.drill_topics import Fault
from rpud_sim.inspection.report.running_statistics import Distribution, usable

MOST_PERIODS = 200  # number of segments of one drill; the last one holds the rest of the run
_NEAR = 1e-6  # s; boundaries that are closer are one


@dataclass
class Period:
    """Segment of a run in which no command and no fault begins or ends."""

    begin: float  # since the bag began [s]
    end: float  # since the bag began [s]
    commands: str = ""  # that are in force
    faults: str = ""  # that are active
    peak_force: Distribution = field(default_factory=Distribution)  # of its impacts [N]
    reacting_force: Distribution = field(default_factory=Distribution)  # of the samples in it [N]
    impacts: int = 0  # number of impacts
    intervals: int = 0  # number of intervals between its impacts
    spanned: float = 0.0  # time of these intervals [s]
    energy: float = 0.0  # of its impacts [J]

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.end - self.begin

    @property
    def impact_rate(self) -> float:
        """Impacts per second, by the intervals between them [1/s]."""
        if self.intervals and self.spanned > 0.0:
            return self.intervals / self.spanned
        return self.impacts / self.duration if self.duration > 0.0 else math.nan

    @property
    def power(self) -> float:
        """Power of the impacts: of each the mean energy, times their rate [W]."""
        return self.energy / self.impacts * self.impact_rate if self.impacts else 0.0


class Periods:
    """Segments of one drill, which are filled while its bag is read."""

    def __init__(self, periods: Sequence[Period], unlisted: int = 0) -> None:
        self.all = tuple(periods)
        self.unlisted = unlisted
        self._begins = np.array([period.begin for period in self.all])
        self._last: float | None = None

    def add_impacts(self, columns: Mapping[str, np.ndarray], times: np.ndarray) -> None:
        """Add rows of the topic of impacts, in order, at times since the bag began [s]."""
        for period, part in self._parts(times):
            found = times[part]
            forces, energies = columns["peak_force"][part], columns["energy"][part]
            period.peak_force.add(forces)
            period.impacts += len(found)
            period.energy += float(energies[usable(energies)].sum())
            first = found[0] if self._last is None else self._last
            # An interval that began before the segment belongs to none.
            steps = np.diff(found, prepend=first if first >= period.begin else found[0])
            steps = steps[steps > 0.0]
            period.intervals += len(steps)
            period.spanned += float(steps.sum())
            self._last = float(found[-1])

    def add_force(self, forces: np.ndarray, times: np.ndarray) -> None:
        """Add samples of the reacting force [N] at times since the bag began [s]."""
        for period, part in self._parts(times):
            period.reacting_force.add(forces[part])

    def end_at(self, span: float) -> None:
        """Set the end of the last segment, and of those that begin after it [s]."""
        for period in self.all:
            period.end = min(period.end, max(span, period.begin))

    def _parts(self, times: np.ndarray) -> Iterator[tuple[Period, slice]]:
        if not len(times):
            return
        places = np.maximum(np.searchsorted(self._begins, times[[0, -1]], side="right") - 1, 0)
        if places[0] == places[1]:
            yield self.all[int(places[0])], slice(0, len(times))
            return
        places = np.maximum(np.searchsorted(self._begins, times, side="right") - 1, 0)
        cuts = [0, *(np.flatnonzero(np.diff(places)) + 1).tolist(), len(times)]
        for first, last in pairwise(cuts):
            yield self.all[int(places[first])], slice(first, last)


def to_periods(changes: Sequence[Change], faults: Sequence[Fault]) -> Periods:
    moments = {0.0}
    moments.update(change.time for change in changes)
    moments.update(fault.onset for fault in faults)
    moments.update(fault.clear for fault in faults if fault.clear is not None)
    begins: list[float] = []
    for moment in sorted(moment for moment in moments if math.isfinite(moment)):
        if moment >= 0.0 and (not begins or moment - begins[-1] > _NEAR):
            begins.append(moment)
    kept = begins[:MOST_PERIODS]
    ends = [*kept[1:], math.inf]
    found = []
    for begin, end in zip(kept, ends, strict=True):
        before = [change.in_force for change in changes if change.time <= begin + _NEAR]
        active = [
            f"{fault.kind} {fault.channel}".strip()
            for fault in faults
            if fault.onset <= begin + _NEAR and (fault.clear is None or fault.clear > begin + _NEAR)
        ]
        found.append(Period(begin, end, before[-1] if before else "", ", ".join(active)))
    return Periods(found, len(begins) - len(kept))
