"""Evaluation: formulas as step functions over a recording, from their parts upward."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

import rpud_sim.verdicts.formulas as f
from rpud_sim.bag import Kind
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.verdicts.messages import NONE, FieldSamples, MissingMessages, get, time_of, to_floats
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
    aligned,
    beginnings,
    bounds,
    columns,
    combine,
    compared,
    inserted,
    negate,
    over_window,
    shared,
    sorted_windows,
    until,
    window_spans,
)
from rpud_sim.verdicts.units import Number, Window

_Bounds = tuple[np.ndarray, np.ndarray, np.ndarray]  # times [ns], least and greatest values


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
        self.record = record
        self._zero = zero
        self._found: dict[tuple[f.Formula, bool], Steps] = {}

    def steps(self, formula: f.Formula, once: bool = False) -> Steps:
        """Return a formula as a step function, ``once`` only at the beginning, which is faster."""
        key = (formula, once)
        if key not in self._found:
            self._found[key] = self._computed(formula, once)
        return self._found[key]

    def _computed(self, formula: f.Formula, once: bool) -> Steps:
        match formula:
            case f.Compare() | f.HasText():
                return self._compared_signal(formula)
            case f.Active():
                return self._active(formula)
            case f.Becomes(inner):
                return beginnings(self.steps(inner))
            case f.Event():
                return self._event(formula)
            case f.Not(inner):
                return negate(self.steps(inner, once))
            case f.And(parts) | f.Or(parts):
                return combine([self.steps(each, once) for each in parts], type(formula) is f.And)
            case f.Implies(condition, then):
                return self.steps(f.Or((f.Not(condition), then)), once)
            case f.Always(inner, window) | f.Eventually(inner, window):
                least = type(formula) is f.Always
                return over_window(self.steps(inner), window.start, window.end, least, once)
            case f.Until():
                return self._until(formula)
            case f.After():
                return self._after(formula, once)
            case f.Count():
                return self._count(formula)
            case f.Quantile():
                return self._quantile(formula, once)
        raise TypeError(f"{formula!r} has no meaning")

    def seconds(self, time: int) -> float:
        """Return an instant [ns] as simulation time [s]."""
        return (time - self._zero) / SECOND

    def trigger(self, formula: f.Formula) -> Steps:
        """Return the instants of the event for which a trigger is written."""
        return self.steps(event_of(formula))

    def _constant(self, value: np.ndarray, absent: bool = False) -> Steps:
        starts = np.array([self.begin, self.end + 1], np.int64)
        return Steps(starts, np.column_stack([value, UNKNOWN]), np.array([absent, False]))

    def _until(self, formula: f.Until) -> Steps:
        kept, window = self.steps(formula.formula), formula.window
        found = until(kept, self.steps(formula.goal), window.start, window.end)
        if not formula.weak:
            return found
        return combine([found, over_window(kept, 0, None, least=True)], least=False)

    def _after(self, formula: f.After, once: bool) -> Steps:
        trigger, then = self.trigger(formula.trigger), self.steps(formula.formula)
        implied = combine([negate(trigger), then], least=False)
        implied, never = aligned(implied, trigger)
        absent = implied.absent | (never.values[MOST_TRUTH] < 0.0) | never.absent
        spread = Steps(implied.starts, implied.values, absent)
        always = over_window(spread, 0, None, least=True, once=once)
        # An event that may not have come at all proves nothing.
        came = over_window(trigger, 0, None, least=False, once=once)
        always, came = aligned(always, came)
        unsure = (came.values[LEAST_TRUTH] < 0.0) & (always.values[LEAST_TRUTH] > 0.0)
        always.values[:, unsure] = UNKNOWN[:, None]
        return always.merged()

    def _compared_signal(self, part: f.Compare | f.HasText) -> Steps:
        """Return a comparison or a word, with each message's value until the next one."""
        topic = part.signal.topic
        hold = PERIODIC_HOLD if topic in PERIODIC else NEVER
        samples = self._samples(part)
        lost = self.record.lost(topic) > 0
        if not len(samples.stamps):
            return self._constant(UNKNOWN, absent=not lost)
        stamps, values, gaps = samples.one_a_stamp(self._judged(part, samples))
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

    def _samples(self, part: f.SignalFormula) -> FieldSamples:
        """Return the messages' values of the signal of a formula, all within the recording."""
        topic, field = part.signal.topic, self.record.field(part.signal)
        check_use(part, field)
        samples = self.record.messages(topic).samples(part.signal.field, field)
        values = samples.values
        if not isinstance(part, f.HasText):
            if field is not None and field.column.kind is Kind.TIME:
                values = (values - self._zero) / SECOND
            elif field is not None and field.column.kind is Kind.DURATION:
                values = values / SECOND
            values = to_floats(values)
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

    def _judged(self, part: f.Compare | f.HasText, samples: FieldSamples) -> np.ndarray:
        """Return the bounds of a comparison or a word, one column a message."""
        if isinstance(part, f.HasText):
            same = np.array([value == part.word for value in samples.values.tolist()], bool)
            return np.where(same, TRUE[:, None], FALSE[:, None])
        number, tolerance = (self.threshold(n, part.signal) for n in (part.number, part.tolerance))
        return compared(*bounds(samples.values), part.operator, number, tolerance)

    def threshold(self, number: Number, signal: f.Signal) -> float:
        """Return a number in the unit of a signal."""
        return threshold(number, self.record.field(signal), signal)

    def _active(self, part: f.Active) -> Steps:
        faults = self._faults(part)
        if faults is None:
            return self._constant(UNKNOWN, absent=True)
        cuts = np.array([self.begin, self.end + 1, *(time for fault in faults for time in fault)])
        starts = np.unique(cuts[(cuts >= self.begin) & (cuts <= self.end + 1)])
        values = columns(FALSE, len(starts))
        for onset, clear in faults:
            values[:, (starts >= onset) & (starts < clear)] = TRUE[:, None]
        return Steps(starts, values, np.zeros(len(starts), bool)).merged()

    def _faults(self, part: f.Active | f.Onset | f.Cleared) -> list[tuple[int, int]] | None:
        """Return onset and clearing of each fault of a name [ns]; None if they are not known."""
        messages = self.record.messages("faults")
        if not len(messages) or self.record.lost("faults"):
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

    def _event(self, event: f.Event) -> Steps:
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

    def _instants(self, event: f.Event) -> _Instants | None:
        """Return the instants of an event in the recording; None if nothing is known of them."""
        if isinstance(event, (f.Onset, f.Cleared)):
            faults = self._faults(event)
            if faults is None:
                return None
            times = np.array(faults, np.int64).reshape(-1, 2)[:, int(isinstance(event, f.Cleared))]
            stamps = np.sort(times[(times >= self.begin) & (times <= self.end)])
            return _Instants(stamps, columns(TRUE, len(stamps)))
        if isinstance(event, f.Published):
            stamps = self.record.messages(event.topic).stamps
            values = columns(TRUE, len(stamps))
            if event.where is not None and len(stamps):
                samples = self._samples(event.where)
                stamps, values = samples.stamps, self._judged(event.where, samples)
            inside = (stamps >= self.begin) & (stamps <= self.end)
            if not inside.any():
                return None
            missing = self.record.missing(event.topic)
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

    def measured(self, part: f.Formula, time: int) -> tuple[Any, Any] | None:
        """Return the bounds of what a formula compares at a time; None if it is not known.

        It is a value of a signal, a number of events or a quantile.
        """
        match part:
            case f.Count():
                found = self._counted(part)
            case f.Quantile():
                found = self._quantiles(part, once=False)
            case f.Compare() | f.HasText():
                found = self._values(part, time)
            case _:
                return None
        if found is None:
            return None
        times, low, high = found
        number = int(np.searchsorted(times, time, side="right")) - 1
        return None if number < 0 else (low[number], high[number])

    def _values(self, part: f.Compare | f.HasText, time: int) -> _Bounds | None:
        """Return the bounds of the values of a signal; None if its value at a time is unknown."""
        steps = self.steps(part)
        number = steps.at(np.array([time]))[0]
        if steps.absent[number] or (steps.values[:, number] == UNKNOWN).all():
            return None
        samples = self._samples(part)
        if isinstance(part, f.HasText):
            return samples.stamps, samples.values, samples.values
        low, high = bounds(samples.values)
        stamps, rows, _ = samples.one_a_stamp(np.array([low, high, low, high]))
        return stamps, rows[LEAST_MARGIN], rows[MOST_MARGIN]

    def _count(self, formula: f.Count) -> Steps:
        found = self._counted(formula)
        if found is None:
            return self._constant(UNKNOWN, absent=True)
        times, least, most = found
        values = compared(least, most, formula.operator, formula.number)
        return Steps(times, values, np.zeros(len(times), bool)).merged()

    def _counted(self, formula: f.Count) -> _Bounds | None:
        """Return the bounds of the number of events; None if nothing is known of them."""
        end, window = self.end, formula.window
        instants = self._instants(formula.event)
        if instants is None:
            return None
        sure = instants.stamps[instants.values[LEAST_TRUTH] > 0.0]
        maybe = instants.stamps[instants.values[MOST_TRUTH] > 0.0]
        edges = (instants.stamps, instants.first - 1, instants.first, instants.last)
        times = self._times(np.concatenate(edges), window)
        first, last, beyond = window_spans(times, window, end)
        least = shared(sure, sure, first, last)
        most = shared(maybe, maybe, first, last) + instants.missing.among(first, last)
        touched = shared(instants.first, instants.last, first, last) > 0.0
        most[last < first], touched[last < first] = 0.0, False
        most[beyond | touched] = math.inf
        return times, least, most

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

    def _quantile(self, formula: f.Quantile, once: bool) -> Steps:
        found = self._quantiles(formula, once)
        if found is None:
            missing = self.record.missing(formula.signal.topic)
            return self._constant(UNKNOWN, absent=not missing.total)
        times, low, high = found
        threshold = self.threshold(formula.number, formula.signal)
        judged = compared(low, high, formula.operator, threshold)
        return Steps(times, judged, np.zeros(len(times), bool)).merged()

    def _quantiles(self, formula: f.Quantile, once: bool) -> _Bounds | None:
        """Return the bounds of the quantile; None without a message."""
        samples = self._samples(formula)
        inside = samples.stamps >= self.begin
        stamps, values = samples.stamps[inside], samples.values[inside]
        missing = self.record.missing(formula.signal.topic)
        if not len(stamps):
            return None
        times = self._times(stamps, formula.window)
        if once:
            times = np.array([self.begin, self.end + 1])
        begins, ends, beyond = window_spans(times, formula.window, self.end)
        first = np.searchsorted(stamps, begins, side="left")
        last = np.searchsorted(stamps, ends, side="right")
        unseen = missing.among(begins, ends)
        share = Fraction(repr(formula.share))
        low, high = np.full(len(times), -np.inf), np.full(len(times), np.inf)
        lowest, highest = map(sorted_windows, bounds(values))
        for number in np.flatnonzero(~beyond & (last > first)).tolist():
            begin, stop, lost = int(first[number]), int(last[number]), int(unseen[number])
            count = stop - begin + lost
            place = -(-share.numerator * count // share.denominator) - 1  # rounded up, exactly
            if place - lost >= 0:
                low[number] = lowest(begin, stop)[place - lost]
            if place < stop - begin:
                high[number] = highest(begin, stop)[place]
        return times, low, high


def event_of(trigger: f.Formula) -> f.Event:
    """Return the event for which a trigger is written."""
    return trigger if isinstance(trigger, f.Event) else f.Becomes(trigger)
