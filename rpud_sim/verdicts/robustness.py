"""Semantics of formulas: step functions over a recording, from the atoms upward."""

from __future__ import annotations

import dataclasses
import math
from bisect import bisect_left, insort
from fractions import Fraction

import numpy as np

from rpud_sim.verdicts.atoms import Atoms, Instants, bounds, compared, constant
from rpud_sim.verdicts.missing import Missing
from rpud_sim.verdicts.names import Field, threshold
from rpud_sim.verdicts.steps import (
    FALSE,
    LEAST_TRUTH,
    MOST_TRUTH,
    TRUE,
    UNKNOWN,
    Steps,
    combine,
    negate,
    over_window,
    until,
)
from rpud_sim.verdicts.vocabulary import (
    Active,
    After,
    Always,
    And,
    Becomes,
    Cleared,
    Compare,
    Count,
    Event,
    Eventually,
    Formula,
    Implies,
    Message,
    Not,
    Onset,
    Or,
    Quantile,
    Says,
    Until,
    Window,
)


class Evaluation:
    """Formulas as step functions over one recording; each is computed once."""

    def __init__(self, atoms: Atoms) -> None:
        self._atoms = atoms
        self._found: dict[tuple[Formula, bool], Steps] = {}

    @property
    def begin(self) -> int:
        return self._atoms.begin

    @property
    def end(self) -> int:
        return self._atoms.end

    def steps(self, formula: Formula, once: bool = False) -> Steps:
        """Return a formula as a step function, ``once`` only at the beginning, which is faster."""
        key = (formula, once)
        if key not in self._found:
            self._found[key] = self._steps(formula, once)
        return self._found[key]

    def trigger(self, formula: Formula) -> Steps:
        """Return the instants of the event for which a trigger stands."""
        return self.steps(formula if isinstance(formula, Event) else Becomes(formula))

    def _steps(self, formula: Formula, once: bool) -> Steps:
        if isinstance(formula, (Compare, Says)):
            return self._atoms.signal(formula)
        if isinstance(formula, Active):
            return self._atoms.active(formula)
        if isinstance(formula, (Onset, Cleared, Message)):
            return self._atoms.event(formula)
        if isinstance(formula, Becomes):
            return _beginnings(self.steps(formula.formula))
        if isinstance(formula, Not):
            return negate(self.steps(formula.formula, once))
        if isinstance(formula, (And, Or)):
            parts = [self.steps(each, once) for each in formula.formulas]
            return combine(parts, least=isinstance(formula, And))
        if isinstance(formula, Implies):
            condition = negate(self.steps(formula.condition, once))
            return combine([condition, self.steps(formula.formula, once)], least=False)
        if isinstance(formula, (Always, Eventually)):
            within = formula.window
            least = isinstance(formula, Always)
            inner = self.steps(formula.formula)
            return over_window(inner, within.start, within.end, least, once)
        if isinstance(formula, Until):
            return self._until(formula)
        if isinstance(formula, After):
            return self._after(formula, once)
        if isinstance(formula, Count):
            return self._count(formula)
        assert isinstance(formula, Quantile)
        return self._quantile(formula, once)

    def _until(self, formula: Until) -> Steps:
        held, goal = self.steps(formula.formula), self.steps(formula.goal)
        found = until(held, goal, formula.window.start, formula.window.end)
        if not formula.weak:
            return found
        return combine([found, over_window(held, 0, None, least=True)], least=False)

    def _after(self, formula: After, once: bool) -> Steps:
        trigger, then = self.steps_of_after(formula)
        implied = combine([negate(trigger), then], least=False)
        starts = np.union1d(implied.starts, trigger.starts)
        implied, never = implied.on(starts), trigger.on(starts)
        absent = implied.absent | (never.values[MOST_TRUTH] < 0.0) | never.absent
        spread = Steps(starts, implied.values, absent)
        always = over_window(spread, 0, None, least=True, once=once)
        # An event that may not have come at all proves nothing.
        came = over_window(trigger, 0, None, least=False, once=once)
        starts = np.union1d(always.starts, came.starts)
        always, came = always.on(starts), came.on(starts)
        unsure = (came.values[LEAST_TRUTH] < 0.0) & (always.values[LEAST_TRUTH] > 0.0)
        always.values[:, unsure] = UNKNOWN[:, None]
        return Steps(starts, always.values, always.absent).merged()

    def steps_of_after(self, formula: After) -> tuple[Steps, Steps]:
        """Return the trigger and the formula that must hold then."""
        return self.trigger(formula.trigger), self.steps(formula.formula)

    def _instants(self, event: Event) -> Instants | None:
        if isinstance(event, (Onset, Cleared, Message)):
            return self._atoms.instants(event)
        steps = self.steps(event)
        if steps.absent[:-1].all():
            return None
        happens = (steps.values[MOST_TRUTH] > 0.0) & ~steps.absent
        happens[-1] = False
        long = np.zeros(len(happens), bool)
        long[:-1] = np.diff(steps.starts) > 1  # unknown for longer than an instant
        chosen = happens & ~long
        open_ = np.flatnonzero(happens & long)
        first, last = steps.starts[open_], steps.starts[open_ + 1] - 1
        return Instants(steps.starts[chosen], steps.values[:, chosen], first=first, last=last)

    def _count(self, formula: Count) -> Steps:
        begin, end = self.begin, self.end
        instants = self._instants(formula.event)
        if instants is None:
            return constant(begin, end, UNKNOWN, absent=True)
        window = formula.window
        sure = instants.stamps[instants.values[LEAST_TRUTH] > 0.0]
        maybe = instants.stamps[instants.values[MOST_TRUTH] > 0.0]
        edges = (instants.stamps, instants.first - 1, instants.first, instants.last)
        times = self._times(np.concatenate(edges), window)
        if formula.until is None:
            first, last = _span(times, window, end)
            surely_last, beyond = last, _beyond(times, window, end)
        else:
            goal = self.steps(formula.until)
            times = np.union1d(times, goal.starts)
            first = times
            surely_last = _next(goal, (goal.values[MOST_TRUTH] > 0.0) | goal.absent, times, end) - 1
            last = _next(goal, (goal.values[LEAST_TRUTH] > 0.0) & ~goal.absent, times, end) - 1
            beyond = last >= end
        least = _inside(sure, first, surely_last)
        most = _inside(maybe, first, last) + instants.missing.among(first, last)
        touched = _touched(instants, first, last)
        most[last < first], touched[last < first] = 0.0, False
        most[beyond | touched] = math.inf
        values = compared(least, most, formula.operator, formula.number)
        return Steps(times, values, np.zeros(len(times), bool)).merged()

    def _times(self, stamps: np.ndarray, window: Window) -> np.ndarray:
        edges = [np.array([self.begin, self.end + 1]), stamps + 1 - window.start]
        if window.end is not None:
            edges += [stamps - window.end, np.array([self.end + 1 - window.end])]
        else:
            edges.append(np.array([self.end + 1 - window.start]))
        times = np.unique(np.concatenate(edges))
        return times[(times >= self.begin) & (times <= self.end + 1)]

    def _quantile(self, formula: Quantile, once: bool) -> Steps:
        samples = self._atoms.samples(formula)
        record = self._atoms.record
        inside = samples.stamps >= self.begin
        stamps, values = samples.stamps[inside], samples.values[inside]
        missing = record.missing(formula.signal.topic)
        if not len(stamps):
            return constant(self.begin, self.end, UNKNOWN, absent=not missing.total)
        times = self._times(stamps, formula.window)
        if once:
            times = np.array([self.begin, self.end + 1])
        low, high = _window_quantiles(formula, stamps, values, times, missing, self.end)
        field = record.field(formula.signal)
        known = field if isinstance(field, Field) else None
        number = threshold(formula.number, known, str(formula.signal))
        judged = compared(low, high, formula.operator, number)
        return Steps(times, judged, np.zeros(len(times), bool)).merged()


def _beginnings(steps: Steps) -> Steps:
    if steps.absent[:-1].all():
        return Steps(steps.starts, steps.values.copy(), steps.absent.copy())
    true = (steps.values[LEAST_TRUTH] > 0.0) & ~steps.absent
    false = (steps.values[MOST_TRUTH] < 0.0) | steps.absent
    before_true = np.concatenate([[False], true[:-1]])
    before_false = np.concatenate([[True], false[:-1]])
    starts: list[int] = []
    columns: list[np.ndarray] = []
    for number, start in enumerate(steps.starts.tolist()):
        if true[number]:
            if not before_true[number]:
                starts.append(start)
                columns.append(TRUE if before_false[number] else UNKNOWN)
                start += 1
                if start == steps.starts[number + 1]:
                    continue
            starts.append(start)
            columns.append(FALSE)
        else:
            starts.append(start)
            columns.append(FALSE if false[number] else UNKNOWN)
    found = Steps(np.array(starts, np.int64), np.column_stack(columns), np.zeros(len(starts), bool))
    return found.merged()


def _span(times: np.ndarray, window: Window, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and the last instant of the window of each time."""
    last = np.full(len(times), end) if window.end is None else times + window.end
    return times + window.start, last


def _next(steps: Steps, chosen: np.ndarray, times: np.ndarray, end: int) -> np.ndarray:
    """Return the first instant from each time on in one of the chosen steps, or after the end."""
    starts = np.append(steps.starts[chosen & (steps.starts <= end)], end + 1)
    found = starts[np.searchsorted(starts, times, side="left")]
    inside = chosen[steps.at(times)] & (times <= end)
    return np.where(inside, times, found)


def _inside(stamps: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    begun = np.searchsorted(stamps, last, side="right")
    return np.maximum(begun - np.searchsorted(stamps, first, side="left"), 0).astype(float)


def _touched(instants: Instants, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    begun = np.searchsorted(instants.first, last, side="right")
    return begun > np.searchsorted(instants.last, first, side="left")


def _beyond(times: np.ndarray, window: Window, end: int) -> np.ndarray:
    return times + (window.start if window.end is None else window.end) > end


def _window_quantiles(
    formula: Quantile,
    stamps: np.ndarray,
    values: np.ndarray,
    times: np.ndarray,
    missing: Missing,
    end: int,
) -> tuple[np.ndarray, np.ndarray]:
    window, share = formula.window, Fraction(repr(formula.share))
    span = _span(times, window, end)
    first = np.searchsorted(stamps, span[0], side="left")
    last = np.searchsorted(stamps, span[1], side="right")
    unseen = missing.among(*span)
    low, high = np.full(len(times), -np.inf), np.full(len(times), np.inf)
    beyond = _beyond(times, window, end)
    least, most = bounds(values)
    ordered = _Sorted(least), _Sorted(most)
    for number in np.flatnonzero(~beyond & (last > first)).tolist():
        begin, stop, lost = int(first[number]), int(last[number]), int(unseen[number])
        count = stop - begin + lost
        place = -(-share.numerator * count // share.denominator) - 1  # rounded up, exactly
        if place - lost >= 0:
            low[number] = ordered[0].among(begin, stop)[place - lost]
        if place < stop - begin:
            high[number] = ordered[1].among(begin, stop)[place]
    return low, high


@dataclasses.dataclass
class _Sorted:
    values: np.ndarray
    first: int = 0
    last: int = 0
    inside: list[float] = dataclasses.field(default_factory=list)

    def among(self, first: int, last: int) -> list[float]:
        """Return the values from number ``first`` to before ``last``, sorted."""
        if last - self.last > len(self.inside) or first >= self.last:
            self.inside = np.sort(self.values[first:last]).tolist()
        else:
            for value in self.values[self.first : first].tolist():
                del self.inside[bisect_left(self.inside, value)]
            for value in self.values[self.last : last].tolist():
                insort(self.inside, value)
        self.first, self.last = first, last
        return self.inside
