"""Step functions over integer nanoseconds whose values are known or lie between bounds.

A step function ends with a step after the recording, of which nothing is known. A value is four
numbers: least and greatest possible margin, and least and greatest possible truth (1 true, -1
false). Both obey the same minimum and maximum, so every operation treats all four alike.
"""

from __future__ import annotations

import dataclasses
from bisect import bisect_left, insort
from collections.abc import Callable
from typing import Any

import numpy as np

from rpud_sim.verdicts.units import Window

LEAST_MARGIN, MOST_MARGIN, LEAST_TRUTH, MOST_TRUTH = range(4)

UNKNOWN = np.array([-np.inf, np.inf, -1.0, 1.0])
TRUE = np.array([np.inf, np.inf, 1.0, 1.0])
FALSE = np.array([-np.inf, -np.inf, -1.0, -1.0])
LOW, HIGH = [LEAST_MARGIN, LEAST_TRUTH], [MOST_MARGIN, MOST_TRUTH]
_SWAPPED = [MOST_MARGIN, LEAST_MARGIN, MOST_TRUTH, LEAST_TRUTH]


def columns(value: np.ndarray, count: int) -> np.ndarray:
    """Return the same value for each of several steps."""
    return np.repeat(value[:, None], count, axis=1)


@dataclasses.dataclass(frozen=True)
class Steps:
    """Step function from the beginning of a recording on."""

    # first nanosecond of each step, increasing; the last is that after the recording
    starts: np.ndarray
    values: np.ndarray  # bounds of each step, one column a step; unknown in the last
    absent: np.ndarray  # whether a signal has no value yet, so that the formula means nothing there

    def __post_init__(self) -> None:
        self.values[:, -1] = UNKNOWN
        self.absent[-1] = False

    @property
    def end(self) -> int:
        return int(self.starts[-1]) - 1

    @property
    def begin(self) -> int:
        return int(self.starts[0])

    def at(self, times: np.ndarray) -> np.ndarray:
        """Return the numbers of the steps that hold certain instants, none before the first."""
        return np.searchsorted(self.starts, times, side="right") - 1

    def on(self, starts: np.ndarray) -> Steps:
        """Return the same function with more steps."""
        steps = self.at(starts)
        return Steps(starts, self.values[:, steps], self.absent[steps])

    def shows(self, time: int, held: bool) -> bool:
        """Return whether it surely holds at an instant, or surely does not."""
        return bool(self._surely(held)[self.at(np.array([time]))[0]])

    def first(self, begin: int, end: int, held: bool) -> int | None:
        """Return the first instant of a span at which it surely holds, or does not [ns]."""
        first = max(int(self.at(np.array([begin]))[0]), 0)
        found = np.flatnonzero((self._surely(held) & ~self.absent)[first:])
        if not len(found):
            return None
        instant = max(int(self.starts[first + found[0]]), begin)
        return instant if instant <= end else None

    def sure(self, begin: int) -> list[int]:
        """Return from when on it surely holds, for each step that begins then or later [ns]."""
        return [int(start) for start in self.starts[self._surely(True) & (self.starts >= begin)]]

    def _surely(self, held: bool) -> np.ndarray:
        sure: np.ndarray
        sure = self.values[LEAST_TRUTH] > 0.0 if held else self.values[MOST_TRUTH] < 0.0
        return sure

    def merged(self) -> Steps:
        """Return the same function with as few steps as possible."""
        same = (self.values[:, 1:] == self.values[:, :-1]).all(axis=0)
        same &= self.absent[1:] == self.absent[:-1]
        keep = np.concatenate([[True], ~same])
        keep[-1] = True
        return Steps(self.starts[keep], self.values[:, keep], self.absent[keep])


def bounds(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the greatest that values may be: NaN may be anything."""
    unknown = np.isnan(values)
    return np.where(unknown, -np.inf, values), np.where(unknown, np.inf, values)


def compared(
    low: np.ndarray, high: np.ndarray, operator: str, number: float, tolerance: float = 0.0
) -> np.ndarray:
    """Return the bounds of comparisons of values that lie between bounds."""
    values = np.empty((4, len(low)))
    ends: Any  # what is compared for the least and for the greatest truth
    if operator in ("<", "<="):
        values[LEAST_MARGIN], values[MOST_MARGIN] = number - high, number - low
        ends = (high, number), (low, number)
    elif operator in (">", ">="):
        values[LEAST_MARGIN], values[MOST_MARGIN] = low - number, high - number
        ends = (number, low), (number, high)
    else:
        furthest = np.maximum(abs(low - number), abs(high - number))
        nearest = np.maximum(np.maximum(low - number, number - high), 0.0)
        values[LEAST_MARGIN], values[MOST_MARGIN] = tolerance - furthest, tolerance - nearest
        ends = (furthest, tolerance), (nearest, tolerance)
    for row, (left, right) in zip((LEAST_TRUTH, MOST_TRUTH), ends, strict=True):
        values[row] = np.where(left < right if operator in ("<", ">") else left <= right, 1.0, -1.0)
    return -values[_SWAPPED] if operator == "!=" else values


def negate(steps: Steps) -> Steps:
    """Return not."""
    return Steps(steps.starts, -steps.values[_SWAPPED], steps.absent.copy())


def aligned(*parts: Steps) -> list[Steps]:
    """Return the same functions with steps that all of them have."""
    starts = parts[0].starts
    for part in parts[1:]:
        if len(part.starts) != len(starts) or (part.starts != starts).any():
            starts = np.union1d(starts, part.starts)
    return [part.on(starts) for part in parts]


def combine(parts: list[Steps], least: bool) -> Steps:
    """Return and (the least of all) or or (the greatest of all).

    Where a part is absent, it is unknown; the result is absent there if the others do not decide.
    """
    spread = aligned(*parts)
    choose = np.minimum if least else np.maximum
    values = _known(spread[0])
    absent = spread[0].absent.copy()
    for part in spread[1:]:
        values = choose(values, _known(part))
        absent |= part.absent
    absent &= values[LEAST_TRUTH] < values[MOST_TRUTH]
    return Steps(spread[0].starts, values, absent).merged()


def _known(steps: Steps) -> np.ndarray:
    values: np.ndarray = steps.values.copy()
    values[:, steps.absent] = UNKNOWN[:, None]
    return values


def _unknown_where_absent(steps: Steps) -> Steps:
    return Steps(steps.starts, _known(steps), np.zeros(len(steps.starts), bool))


def over_window(
    steps: Steps, start: int, end: int | None, least: bool, once: bool = False
) -> Steps:
    """Return always (the ``least`` value in a window) or eventually (the greatest).

    The window is from ``start`` to ``end`` after each instant [ns], None for all. Absent instants
    do not count; without any other the result is absent. ``once`` is for the beginning alone.
    """
    last = len(steps.starts) - 1
    times = steps.starts[[0, -1]]
    if not once:
        cuts = [steps.starts, steps.starts - start]
        if end is not None and end != start:
            cuts.append(steps.starts - end)
        times = np.unique(np.concatenate(cuts))
        times = times[(times >= steps.begin) & (times <= steps.end + 1)]
    first = np.minimum(steps.at(times + start), last)
    final = first if end is None else steps.at(times + end)
    neutral = np.inf if least else -np.inf
    rows = steps.values.copy()
    rows[:, steps.absent] = neutral
    table = np.vstack([rows, np.where(steps.absent, 1.0, 0.0)[None]])
    if not least:
        table[:4] = -table[:4]
    if end is None:  # every range but an empty one ends with the recording
        table[:, :last] = np.minimum.accumulate(table[:, :last][:, ::-1], axis=1)[:, ::-1]
        found = table[:, first]
    else:
        found = _least_in_ranges(table, first, final)
    absent = found[4] > 0.5
    values = found[:4] if least else -found[:4]
    values[:, absent] = UNKNOWN[:, None]
    return Steps(times, values, absent).merged()


def _least_in_ranges(table: np.ndarray, first: np.ndarray, final: np.ndarray) -> np.ndarray:
    result = np.empty((len(table), len(first)))
    levels = np.floor(np.log2(final - first + 1)).astype(np.int64)
    level, length = 0, 1
    while True:
        chosen = levels == level
        if chosen.any():
            result[:, chosen] = np.minimum(
                table[:, first[chosen]], table[:, final[chosen] - length + 1]
            )
        if level >= levels.max():
            return result
        table = np.minimum(table[:, :-length], table[:, length:])
        level, length = level + 1, 2 * length


def until(left: Steps, right: Steps, start: int, end: int | None) -> Steps:
    """Return ``left`` until ``right``: left holds from each instant to just before right.

    Right comes in a window from ``start`` to ``end`` after each instant [ns]; None is the end of
    the recording.
    """
    # Without a bound on its end the goal must come in the recording; otherwise it may come later.
    plain = _until_at_once(left, right, FALSE if end is None else UNKNOWN)
    parts = [plain]
    if start:
        held = over_window(_unknown_where_absent(left), 0, start - 1, least=True)
        parts = [held, over_window(plain, start, start, least=True)]
    if end is not None:
        parts.append(over_window(_unknown_where_absent(right), start, end, least=False))
    found, left, right = aligned(combine(parts, least=True), left, right)
    absent = left.absent | right.absent
    absent &= found.values[LEAST_TRUTH] < found.values[MOST_TRUTH]
    return Steps(found.starts, found.values, absent).merged()


def _until_at_once(left: Steps, right: Steps, beyond: np.ndarray) -> Steps:
    """Return ``left`` until ``right`` at any time; beyond the recording it has a given value."""
    left, right = aligned(left, right)
    # At each step u = max(right, min(left, u of the next step)): a number clamped to bounds.
    # Clamps put one after the other are a clamp, so that doubling strides reach every step's end.
    low = _known(right)
    high = np.maximum(low, _known(left))
    low[:, -1] = high[:, -1] = beyond
    stride = 1
    while stride < low.shape[1]:
        behind_low, behind_high = low[:, stride:].copy(), high[:, stride:].copy()
        front_low, front_high = low[:, :-stride].copy(), high[:, :-stride].copy()
        low[:, :-stride] = np.clip(behind_low, front_low, front_high)
        high[:, :-stride] = np.clip(behind_high, front_low, front_high)
        stride *= 2
    return Steps(left.starts, low, np.zeros(low.shape[1], bool))


def inserted(starts: np.ndarray, values: np.ndarray, others: np.ndarray) -> Steps:
    """Return steps with values, and others between them that are false."""
    starts = np.concatenate([starts, others])
    values = np.hstack([values, columns(FALSE, len(others))])
    order = np.argsort(starts)
    return Steps(starts[order], values[:, order], np.zeros(len(starts), bool))


def beginnings(steps: Steps) -> Steps:
    """Return the instants at which a formula begins to hold."""
    if steps.absent[:-1].all():
        return Steps(steps.starts, steps.values.copy(), steps.absent.copy())
    true = (steps.values[LEAST_TRUTH] > 0.0) & ~steps.absent
    false = (steps.values[MOST_TRUTH] < 0.0) | steps.absent
    begins = true & ~np.append(False, true[:-1])
    values = np.where(true | false, FALSE[:, None], UNKNOWN[:, None])
    after_false = np.append(True, false[:-1])
    values[:, begins] = np.where(after_false, TRUE[:, None], UNKNOWN[:, None])[:, begins]
    longer = begins & np.append(np.diff(steps.starts) > 1, False)
    return inserted(steps.starts, values, steps.starts[longer] + 1).merged()


def window_spans(
    times: np.ndarray, window: Window, end: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return first and last instant of the window of each time, and whether it ends too late."""
    last = np.full(len(times), end) if window.end is None else times + window.end
    return times + window.start, last, np.maximum(times + window.start, last) > end


def shared(begins: np.ndarray, ends: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return how many stretches of time, in order, share an instant with each of some spans."""
    begun = np.searchsorted(begins, last, side="right")
    ended = np.searchsorted(ends, first, side="left")
    count: np.ndarray = np.maximum(begun - ended, 0).astype(float)
    return count


def sorted_windows(values: np.ndarray) -> Callable[[int, int], list[float]]:
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
