"""Evaluation: formulas as step functions over a recording, from their parts upward."""

from __future__ import annotations

import dataclasses
import math
from bisect import bisect_left, insort
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import Kind
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.verdicts.formulas import (
    Active,
    Becomes,
    Cleared,
    Compare,
    Count,
    Event,
    Formula,
    Message,
    Onset,
    Quantile,
    Says,
    Signal,
    SignalFormula,
)
from rpud_sim.verdicts.messages import NONE, FieldSamples, MissingMessages, get, time_of
from rpud_sim.verdicts.names import PERIODIC, PERIODIC_HOLD, TYPES, check_use, threshold
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
    bounds,
    columns,
    compared,
    inserted,
)
from rpud_sim.verdicts.units import Number, Window

_LOW, _HIGH = [LEAST_MARGIN, LEAST_TRUTH], [MOST_MARGIN, MOST_TRUTH]


class _Instants(NamedTuple):
    """Instants of an event, one for each time that it happens."""

    stamps: np.ndarray  # of the instants, increasing; several may be equal [ns]
    values: np.ndarray  # bounds of the truth at each, one column an instant
    missing: MissingMessages = MissingMessages()  # further events that may have been
    # of each stretch of time in which any number of events may be [ns]
    first: np.ndarray = NONE
    last: np.ndarray = NONE


class Evaluation:
    """Formulas over one span of a record; each is computed once. ``zero`` is time zero [ns]."""

    def __init__(self, record: Record, begin: int, end: int, zero: int) -> None:
        self.begin = begin
        self.end = end
        self._record = record
        self._zero = zero
        self._found: dict[tuple[Formula, bool], Steps] = {}

    def steps(self, formula: Formula, once: bool = False) -> Steps:
        """Return a formula as a step function, ``once`` only at the beginning, which is faster."""
        key = (formula, once)
        if key not in self._found:
            self._found[key] = formula._steps(self, once)
        return self._found[key]

    def trigger(self, formula: Formula) -> Steps:
        """Return the instants of the event for which a trigger stands."""
        return self.steps(formula if isinstance(formula, Event) else Becomes(formula))

    def shown(self, formula: Formula, begin: int, last: int, held: bool) -> int:
        """Return when it shows that a formula holds first in a span, or does not; or its end."""
        found = self.steps(formula).first(begin, last, held)
        return last if found is None else formula._decided(self, found, held)

    def _constant(self, value: np.ndarray, absent: bool = False) -> Steps:
        starts = np.array([self.begin, self.end + 1], np.int64)
        return Steps(starts, np.column_stack([value, UNKNOWN]), np.array([absent, False]))

    def compared_signal(self, part: Compare | Says) -> Steps:
        """Return a comparison or a word, with each message's value until the next one."""
        topic, hold = part.signal.topic, part.signal.hold
        if hold is None:
            hold = PERIODIC_HOLD if topic in PERIODIC else NEVER
        samples = self._samples(part)
        lost = self._record.lost(topic) > 0
        if not len(samples.stamps):
            return self._constant(UNKNOWN, absent=not lost)
        stamps, values, gaps = _one_a_stamp(samples, self._judged(part, samples))
        until = np.where(gaps | lost, stamps + 1, stamps + min(hold, NEVER - int(stamps[-1]) - 1))
        ends = until[until < np.append(stamps[1:], self.end + 1)]
        starts = np.concatenate([stamps, ends, [self.end + 1]])
        rows = np.hstack([values, columns(UNKNOWN, len(ends) + 1)])
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

    def _samples(self, part: SignalFormula) -> FieldSamples:
        """Return the messages' values of the signal of a formula, all within the recording."""
        topic, field = part.signal.topic, self._record.field(part.signal)
        check_use(part, field)
        samples = self._record.messages(topic).samples(part.signal.field, field)
        values = samples.values
        if not isinstance(part, Says):
            if field is not None and field.column.kind is Kind.TIME:
                values = (values - self._zero) / SECOND
            elif field is not None and field.column.kind is Kind.DURATION:
                values = values / SECOND
            values = _floats(values)
        inside = samples.stamps <= self.end
        if topic not in TYPES:  # stamps of others may be of another clock
            inside &= samples.stamps >= self.begin
        return dataclasses.replace(
            samples,
            stamps=samples.stamps[inside],
            values=values[inside],
            gaps=samples.gaps[inside],
            ordered=samples.ordered[inside],
        )

    def _judged(self, part: Compare | Says, samples: FieldSamples) -> np.ndarray:
        """Return the bounds of a comparison or a word, one column a message."""
        if isinstance(part, Says):
            same = np.array([value == part.word for value in samples.values.tolist()], bool)
            return np.where(same, TRUE[:, None], FALSE[:, None])
        number, tolerance = (self._threshold(n, part.signal) for n in (part.number, part.tolerance))
        return compared(*bounds(samples.values), part.operator, number, tolerance)

    def _threshold(self, number: Number, signal: Signal) -> float:
        return threshold(number, self._record.field(signal), signal)

    def active(self, part: Active) -> Steps:
        faults = self._faults(part)
        if faults is None:
            return self._constant(UNKNOWN, absent=True)
        cuts = np.array([self.begin, self.end + 1, *(time for fault in faults for time in fault)])
        starts = np.unique(cuts[(cuts >= self.begin) & (cuts <= self.end + 1)])
        values = columns(FALSE, len(starts))
        for onset, clear in faults:
            values[:, (starts >= onset) & (starts < clear)] = TRUE[:, None]
        return Steps(starts, values, np.zeros(len(starts), bool)).merged()

    def _faults(self, part: Active | Onset | Cleared) -> list[tuple[int, int]] | None:
        """Return onset and clearing of each fault of a name [ns]; None if they are not known."""
        messages = self._record.messages("faults")
        if not len(messages) or self._record.lost("faults"):
            return None
        onsets: dict[int, int] = {}
        clears: dict[int, int] = {}
        for faults in messages.column("faults"):
            for fault in faults:
                if (get(fault, "kind"), get(fault, "channel")) != part.kind_and_channel:
                    continue
                number = int(get(fault, "number"))
                onsets.setdefault(number, time_of(get(fault, "onset")))
                if not get(fault, "active"):
                    clears.setdefault(number, time_of(get(fault, "clear")))
        if any(int(count) for count in messages.column("forgotten")):
            return None
        return [(onset, clears.get(number, NEVER)) for number, onset in onsets.items()]

    def event(self, event: Event) -> Steps:
        """Return an event as a step function that is true for single nanoseconds."""
        instants = self._instants(event)
        if instants is None:
            return self._constant(UNKNOWN, absent=True)
        stamps, first = np.unique(instants.stamps, return_index=True)
        if not len(stamps):
            return self._constant(FALSE)
        values = np.maximum.reduceat(instants.values, first, axis=1)
        rest = np.setdiff1d(np.concatenate([[self.begin], stamps + 1, [self.end + 1]]), stamps)
        found = inserted(stamps, values, rest)
        spans = found.starts, np.append(found.starts[1:] - 1, self.end + 1)
        unseen = instants.missing.among(*spans) > 0
        found.values[:, unseen] = np.maximum(found.values[:, unseen], UNKNOWN[:, None])
        return found

    def _instants(self, event: Event) -> _Instants | None:
        """Return the instants of an event in the recording; None if nothing is known of them."""
        if isinstance(event, (Onset, Cleared)):
            faults = self._faults(event)
            if faults is None:
                return None
            times = np.array(faults, np.int64).reshape(-1, 2)[:, int(isinstance(event, Cleared))]
            stamps = np.sort(times[(times >= self.begin) & (times <= self.end)])
            return _Instants(stamps, columns(TRUE, len(stamps)))
        if isinstance(event, Message):
            stamps = self._record.messages(event.topic).stamps
            values = columns(TRUE, len(stamps))
            if event.where is not None and len(stamps):
                samples = self._samples(event.where)
                stamps, values = samples.stamps, self._judged(event.where, samples)
            inside = (stamps >= self.begin) & (stamps <= self.end)
            if not inside.any():
                return None
            missing = self._record.missing(event.topic)
            return _Instants(stamps[inside], values[:, inside], missing)
        steps = self.steps(event)
        if steps.absent[:-1].all():
            return None
        happens = (steps.values[MOST_TRUTH] > 0.0) & ~steps.absent
        happens[-1] = False
        long = np.append(np.diff(steps.starts) > 1, False)  # unknown for longer than an instant
        chosen, open_ = happens & ~long, np.flatnonzero(happens & long)
        return _Instants(
            steps.starts[chosen],
            steps.values[:, chosen],
            first=steps.starts[open_],
            last=steps.starts[open_ + 1] - 1,
        )

    def count(self, formula: Count) -> Steps:
        end, window = self.end, formula.window
        instants = self._instants(formula.event)
        if instants is None:
            return self._constant(UNKNOWN, absent=True)
        sure = instants.stamps[instants.values[LEAST_TRUTH] > 0.0]
        maybe = instants.stamps[instants.values[MOST_TRUTH] > 0.0]
        edges = (instants.stamps, instants.first - 1, instants.first, instants.last)
        times = self._times(np.concatenate(edges), window)
        if formula.until is None:
            first, last, beyond = _span(times, window, end)
            surely_last = last
        else:
            goal = self.steps(formula.until)
            first = times = np.union1d(times, goal.starts)
            surely_last = _next(goal, (goal.values[MOST_TRUTH] > 0.0) | goal.absent, times, end) - 1
            last = _next(goal, (goal.values[LEAST_TRUTH] > 0.0) & ~goal.absent, times, end) - 1
            beyond = last >= end
        least = _inside(sure, sure, first, surely_last)
        most = _inside(maybe, maybe, first, last) + instants.missing.among(first, last)
        touched = _inside(instants.first, instants.last, first, last) > 0.0
        most[last < first], touched[last < first] = 0.0, False
        most[beyond | touched] = math.inf
        values = compared(least, most, formula.operator, formula.number)
        return Steps(times, values, np.zeros(len(times), bool)).merged()

    def _times(self, stamps: np.ndarray, window: Window) -> np.ndarray:
        """Return the instants at which the window of a formula gains or loses a stamp."""
        after = self.end + 1
        edges = [np.array([self.begin, after]), stamps + 1 - window.start]
        if window.end is not None:
            edges += [stamps - window.end, np.array([after - window.end])]
        else:
            edges.append(np.array([after - window.start]))
        times = np.unique(np.concatenate(edges))
        return times[(times >= self.begin) & (times <= after)]

    def quantile(self, formula: Quantile, once: bool) -> Steps:
        samples = self._samples(formula)
        inside = samples.stamps >= self.begin
        stamps, values = samples.stamps[inside], samples.values[inside]
        missing = self._record.missing(formula.signal.topic)
        if not len(stamps):
            return self._constant(UNKNOWN, absent=not missing.total)
        times = self._times(stamps, formula.window)
        if once:
            times = np.array([self.begin, self.end + 1])
        begins, ends, beyond = _span(times, formula.window, self.end)
        first = np.searchsorted(stamps, begins, side="left")
        last = np.searchsorted(stamps, ends, side="right")
        unseen = missing.among(begins, ends)
        share = Fraction(repr(formula.share))
        low, high = np.full(len(times), -np.inf), np.full(len(times), np.inf)
        lowest, highest = map(_sorted_windows, bounds(values))
        for number in np.flatnonzero(~beyond & (last > first)).tolist():
            begin, stop, lost = int(first[number]), int(last[number]), int(unseen[number])
            count = stop - begin + lost
            place = -(-share.numerator * count // share.denominator) - 1  # rounded up, exactly
            if place - lost >= 0:
                low[number] = lowest(begin, stop)[place - lost]
            if place < stop - begin:
                high[number] = highest(begin, stop)[place]
        threshold = self._threshold(formula.number, formula.signal)
        judged = compared(low, high, formula.operator, threshold)
        return Steps(times, judged, np.zeros(len(times), bool)).merged()


def _floats(values: np.ndarray) -> np.ndarray:
    """Return numbers; NaN for what is none."""
    if values.dtype != object:
        return values.astype(float)
    plain = [
        each[0] if isinstance(each, bytes) and len(each) == 1 else each for each in values.tolist()
    ]
    return np.array([float(x) if isinstance(x, (int, float)) else np.nan for x in plain], float)


def _one_a_stamp(
    samples: FieldSamples, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
            kept[_LOW, number], kept[_HIGH, number] = group[_LOW].min(1), group[_HIGH].max(1)
    return samples.stamps[last], kept, samples.gaps[last]


def _span(times: np.ndarray, window: Window, end: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return first and last instant of the window of each time, and whether it ends too late."""
    last = np.full(len(times), end) if window.end is None else times + window.end
    return times + window.start, last, np.maximum(times + window.start, last) > end


def _next(steps: Steps, chosen: np.ndarray, times: np.ndarray, end: int) -> np.ndarray:
    """Return the first instant from each time on in one of the chosen steps, or after the end."""
    starts = np.append(steps.starts[chosen & (steps.starts <= end)], end + 1)
    found = starts[np.searchsorted(starts, times, side="left")]
    inside = chosen[steps.at(times)] & (times <= end)
    return np.where(inside, times, found)


def _inside(
    begins: np.ndarray, ends: np.ndarray, first: np.ndarray, last: np.ndarray
) -> np.ndarray:
    """Return how many stretches of time, in order, share an instant with each of some spans."""
    begun = np.searchsorted(begins, last, side="right")
    ended = np.searchsorted(ends, first, side="left")
    shared: np.ndarray = np.maximum(begun - ended, 0).astype(float)
    return shared


def _sorted_windows(values: np.ndarray) -> Callable[[int, int], list[float]]:
    """Return a function that sorts the values from one number to before another.

    Both numbers grow from call to call, and the values that both calls have are sorted already.
    """
    begun = ended = 0
    inside: list[float] = []

    def among(first: int, last: int) -> list[float]:
        nonlocal begun, ended, inside
        if last - ended > len(inside) or first >= ended:
            inside = np.sort(values[first:last]).tolist()
        else:
            for value in values[begun:first].tolist():
                del inside[bisect_left(inside, value)]
            for value in values[ended:last].tolist():
                insort(inside, value)
        begun, ended = first, last
        return inside

    return among
