"""Formulas without others in them: comparisons, words, faults and events, as step functions."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.bag import Kind
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.verdicts.messages import Samples, get, time_of
from rpud_sim.verdicts.missing import Missing
from rpud_sim.verdicts.names import PERIODIC, PERIODIC_HOLD, TYPES, Field, check_use, threshold
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.steps import (
    FALSE,
    LEAST_MARGIN,
    LEAST_TRUTH,
    MOST_MARGIN,
    MOST_TRUTH,
    TRUE,
    UNKNOWN,
    Steps,
)
from rpud_sim.verdicts.vocabulary import (
    Active,
    Cleared,
    Compare,
    Message,
    Onset,
    Quantile,
    Says,
    split_fault,
)


def _none() -> np.ndarray:
    return np.empty(0, np.int64)


@dataclasses.dataclass(frozen=True)
class Instants:
    """Instants of an event, one for each time that it happens."""

    stamps: np.ndarray  # of the instants, increasing; several may be equal [ns]
    values: np.ndarray  # bounds of the truth at each, one column an instant
    # further events that may have been
    missing: Missing = dataclasses.field(default_factory=Missing.none)
    # of each stretch of time in which any number of events may be [ns]
    first: np.ndarray = dataclasses.field(default_factory=_none)
    last: np.ndarray = dataclasses.field(default_factory=_none)  # of each such stretch [ns]


def constant(begin: int, end: int, value: np.ndarray, absent: bool = False) -> Steps:
    """Return a step function with one value in the whole recording."""
    return Steps(
        np.array([begin, end + 1], np.int64),
        np.column_stack([value, UNKNOWN]),
        np.array([absent, False]),
    )


def compared(
    low: np.ndarray, high: np.ndarray, operator: str, number: float, tolerance: float = 0.0
) -> np.ndarray:
    """Return the bounds of comparisons of values that lie between bounds."""
    values = np.empty((4, len(low)))
    ends: Any  # what is compared for the least and for the greatest truth
    if operator in ("<", "<="):
        values[LEAST_MARGIN], values[MOST_MARGIN] = number - high, number - low
        strict, ends = operator == "<", ((high, number), (low, number))
    elif operator in (">", ">="):
        values[LEAST_MARGIN], values[MOST_MARGIN] = low - number, high - number
        strict, ends = operator == ">", ((number, low), (number, high))
    else:
        furthest = np.maximum(abs(low - number), abs(high - number))
        nearest = np.maximum(np.maximum(low - number, number - high), 0.0)
        values[LEAST_MARGIN], values[MOST_MARGIN] = tolerance - furthest, tolerance - nearest
        strict, ends = False, ((furthest, tolerance), (nearest, tolerance))
    for row, (left, right) in zip((LEAST_TRUTH, MOST_TRUTH), ends, strict=True):
        values[row] = np.where(left < right if strict else left <= right, 1.0, -1.0)
    if operator == "!=":
        values = -values[[MOST_MARGIN, LEAST_MARGIN, MOST_TRUTH, LEAST_TRUTH]]
    return values


class Atoms:
    """Step functions and instants of formulas without parts; ``zero`` is time zero's stamp [ns]."""

    def __init__(self, record: Record, begin: int, end: int, zero: int) -> None:
        self.record = record
        self.begin = begin
        self.end = end
        self._zero = zero

    def signal(self, part: Compare | Says) -> Steps:
        """Return a comparison or a word as a step function of the messages that hold."""
        hold = part.signal.hold
        if hold is None:
            hold = PERIODIC_HOLD if part.signal.topic in PERIODIC else NEVER
        samples = self.samples(part)
        return self._held(samples, self.judged(part, samples), part.signal.topic, hold)

    def samples(self, part: Compare | Says | Quantile) -> Samples:
        """Return the messages' values of the signal of a formula, all within the recording."""
        field = self.record.field(part.signal)
        check_use(part, field if isinstance(field, Field) else None)
        samples = self.record.messages(part.signal.topic).samples(
            part.signal.field if field is None else field
        )
        values = samples.values
        if not isinstance(part, Says):
            if isinstance(field, Field) and field.column.kind is Kind.TIME:
                values = (values - self._zero) / SECOND
            elif isinstance(field, Field) and field.column.kind is Kind.DURATION:
                values = values / SECOND
            values = _floats(values)
        inside = samples.stamps <= self.end
        if part.signal.topic not in TYPES:  # stamps of others may be of another clock
            inside &= samples.stamps >= self.begin
        return Samples(
            samples.stamps[inside],
            values[inside],
            samples.gaps[inside],
            samples.first_missing,
            samples.ordered[inside],
        )

    def judged(self, part: Compare | Says, samples: Samples) -> np.ndarray:
        """Return the bounds of a comparison or a word, one column a message."""
        if isinstance(part, Says):
            same = np.array([value == part.word for value in samples.values.tolist()], bool)
            return np.where(same, TRUE[:, None], FALSE[:, None])
        field = self.record.field(part.signal)
        known = field if isinstance(field, Field) else None
        number = threshold(part.number, known, str(part.signal))
        tolerance = threshold(part.tolerance, known, str(part.signal))
        low, high = bounds(samples.values)
        return compared(low, high, part.operator, number, tolerance)

    def instants(self, event: Onset | Cleared | Message) -> Instants | None:
        """Return the instants of an event in the recording; None if nothing is known of them."""
        if not isinstance(event, Message):
            faults = self._faults(event.fault)
            if faults is None:
                return None
            onset = isinstance(event, Onset)
            times = sorted(first if onset else last for first, last in faults)
            stamps = np.array([time for time in times if self.begin <= time <= self.end], np.int64)
            return Instants(stamps, np.repeat(TRUE[:, None], len(stamps), axis=1))
        messages = self.record.messages(event.topic)
        stamps = messages.stamps
        values = np.repeat(TRUE[:, None], len(stamps), axis=1)
        if event.where is not None and len(stamps):
            samples = self.samples(event.where)
            stamps, values = samples.stamps, self.judged(event.where, samples)
        inside = (stamps >= self.begin) & (stamps <= self.end)
        if not inside.any():
            return None
        missing = self.record.missing(event.topic)
        return Instants(stamps[inside], values[:, inside], missing)

    def event(self, event: Onset | Cleared | Message) -> Steps:
        """Return an event as a step function that is true for single nanoseconds."""
        instants = self.instants(event)
        if instants is None:
            return constant(self.begin, self.end, UNKNOWN, absent=True)
        stamps, first = np.unique(instants.stamps, return_index=True)
        if not len(stamps):
            return constant(self.begin, self.end, FALSE)
        values = np.maximum.reduceat(instants.values, first, axis=1)
        rest = np.setdiff1d(np.concatenate([[self.begin], stamps + 1, [self.end + 1]]), stamps)
        starts = np.concatenate([stamps, rest])
        values = np.hstack([values, np.repeat(FALSE[:, None], len(rest), axis=1)])
        order = np.argsort(starts)
        starts, values = starts[order], values[:, order]
        unseen = instants.missing.among(starts, np.append(starts[1:] - 1, self.end + 1)) > 0
        values[:, unseen] = np.maximum(values[:, unseen], UNKNOWN[:, None])
        return Steps(starts, values, np.zeros(len(starts), bool))

    def active(self, part: Active) -> Steps:
        faults = self._faults(part.fault)
        if faults is None:
            return constant(self.begin, self.end, UNKNOWN, absent=True)
        cuts = np.array([self.begin, self.end + 1, *(time for fault in faults for time in fault)])
        starts = np.unique(cuts[(cuts >= self.begin) & (cuts <= self.end + 1)])
        values = np.repeat(FALSE[:, None], len(starts), axis=1)
        for onset, clear in faults:
            values[:, (starts >= onset) & (starts < clear)] = TRUE[:, None]
        return Steps(starts, values, np.zeros(len(starts), bool)).merged()

    def _faults(self, name: str) -> list[tuple[int, int]] | None:
        """Return onset and clearing of each fault of a name [ns]; None if they are not known."""
        messages = self.record.messages("faults")
        if not len(messages) or self.record.lost("faults"):
            return None
        kind, channel = split_fault(name)
        onsets: dict[int, int] = {}
        clears: dict[int, int] = {}
        for faults in messages.column("faults"):
            for fault in faults:
                if get(fault, "kind") != kind or get(fault, "channel") != channel:
                    continue
                number = int(get(fault, "number"))
                onsets.setdefault(number, time_of(get(fault, "onset")))
                if not get(fault, "active"):
                    clears.setdefault(number, time_of(get(fault, "clear")))
        if any(int(count) for count in messages.column("forgotten")):
            return None
        return [(onset, clears.get(number, NEVER)) for number, onset in onsets.items()]

    def _held(self, samples: Samples, values: np.ndarray, topic: str, hold: int) -> Steps:
        lost = self.record.lost(topic) > 0
        if not len(samples.stamps):
            return constant(self.begin, self.end, UNKNOWN, absent=not lost)
        stamps, values, gaps = _one_a_stamp(samples, values)
        following = np.append(stamps[1:], self.end + 1)
        until = np.where(gaps | lost, stamps + 1, stamps + min(hold, NEVER - int(stamps[-1]) - 1))
        ends = until[until < following]
        starts = np.concatenate([stamps, ends, [self.end + 1]])
        rows = np.hstack([values, np.repeat(UNKNOWN[:, None], len(ends) + 1, axis=1)])
        starts, where = np.unique(starts[::-1], return_index=True)  # of two, the later in the list
        rows = rows[:, ::-1][:, where]
        absent = np.zeros(len(starts), bool)
        if starts[0] > self.begin:
            unknown = lost or samples.first_missing
            starts = np.concatenate([[self.begin], starts])
            rows = np.hstack([UNKNOWN[:, None], rows])
            absent = np.concatenate([[not unknown], absent])
        first = int(np.searchsorted(starts, self.begin, side="right")) - 1
        starts = starts[first:].copy()
        starts[0] = self.begin
        return Steps(starts, rows[:, first:], absent[first:]).merged()


def bounds(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest that values may be: NaN may be anything."""
    unknown = np.isnan(values)
    return np.where(unknown, -np.inf, values), np.where(unknown, np.inf, values)


def _floats(values: np.ndarray) -> np.ndarray:
    if values.dtype != object:
        return values.astype(float)
    return np.array([_float(value) for value in values.tolist()], float)


def _float(value: Any) -> float:
    if isinstance(value, bytes) and len(value) == 1:
        return float(value[0])
    return float(value) if isinstance(value, (int, float)) else np.nan


def _one_a_stamp(samples: Samples, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the last value of each stamp; both bounds of those whose order is not known."""
    last = np.append(samples.stamps[1:] != samples.stamps[:-1], True)
    kept = values[:, last]
    if not samples.ordered.all():
        edges = np.concatenate([[0], np.flatnonzero(last) + 1]).tolist()
        for number, (first, end) in enumerate(pairwise(edges)):
            begin = end - 1
            while begin > first and not samples.ordered[begin]:
                begin -= 1
            group = values[:, begin:end]
            kept[[LEAST_MARGIN, LEAST_TRUTH], number] = group[[LEAST_MARGIN, LEAST_TRUTH]].min(1)
            kept[[MOST_MARGIN, MOST_TRUTH], number] = group[[MOST_MARGIN, MOST_TRUTH]].max(1)
    return samples.stamps[last], kept, samples.gaps[last]
