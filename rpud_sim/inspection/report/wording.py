"""Sentences that say what is seen in the plots of a report, made of their data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rpud_sim.inspection.report.running_statistics import Distribution, Envelope
from rpud_sim.pages.plot import COMMAND, FAULT, Line, Mark
from rpud_sim.pages.words import number

_LEAST_CHANGE = 0.1  # of the greater mean: a smaller change is not worth a word
_LEAST_SCORE = 4.0  # errors of the means: a smaller change may be chance
_FEWEST = 2  # parts of the time on each side of a change


@dataclass(frozen=True)
class _Change:
    before: float
    after: float
    time: float
    reason: str


def over_time(
    name: str, values: Distribution, envelope: Envelope, scale: tuple[float, str], span: float,
    marks: Sequence[Mark],
) -> str:  # fmt: skip
    """Return what a plot over time shows: the range, the mean and the greatest change.

    ``scale`` is factor and name of the unit in which it is shown, ``span`` is in s, and at
    ``marks`` it may change.
    """
    factor, unit = scale
    if not values.count:
        return f"{name}: no values."
    ends = f"between {_number(factor * values.least)} and {_number(factor * values.greatest, unit)}"
    text = f"{name} over {_number(span)} s: {ends}, mean {_number(factor * values.mean, unit)}"
    change = _greatest_change(envelope, marks)
    if change is not None:
        word = "rises" if change.after > change.before else "falls"
        means = f"{_number(factor * change.before)} to {_number(factor * change.after, unit)}"
        text += f"; its mean {word} from {means} at {_number(change.time)} s{change.reason}"
    return f"{text}."


def of_distribution(name: str, values: Distribution, scale: tuple[float, str]) -> str:
    """Return what a histogram shows in a unit: the middle, where most values lie, the ends."""
    factor, unit = scale
    if not values.count:
        return f"{name}: no values."
    low, middle, high = (factor * values.quantile(part) for part in (0.05, 0.5, 0.95))
    return (
        f"{name} of {values.count} impacts: 90 % between {_number(low)} and {_number(high, unit)}, "
        f"median {_number(middle, unit)}, greatest {_number(factor * values.greatest, unit)}."
    )


def of_spectrum(name: str, frequencies: np.ndarray, density: np.ndarray) -> str:
    """Return at which frequency a spectrum has most power for its width: frequency times density.

    Both have the shape (n,), frequencies in Hz.
    """
    if not len(frequencies):
        return f"{name}: no power."
    strongest = frequencies[int(np.argmax(frequencies * density))]
    return f"{name}: most power near {_number(float(strongest))} Hz."


def of_faults(marks: Sequence[Mark]) -> str:
    """Return which faults there are, the first ones with their times."""
    faults = [mark for mark in marks if mark.kind == FAULT]
    texts = [
        f"{fault.text} from {_number(fault.time)} s "
        + ("on" if fault.end is None else f"to {_number(fault.end)} s")
        for fault in faults[:4]
    ]
    more = f"; and {len(faults) - 4} more" if len(faults) > 4 else ""
    noun = "fault" if len(faults) == 1 else "faults"
    return f"{len(faults)} {noun}: {'; '.join(texts)}{more}."


def of_lines(lines: Sequence[Line], unit: str) -> str:
    texts = []
    for line in lines:
        found = line.y[np.isfinite(line.y)]
        ends = "no values"
        if len(found):
            ends = f"between {_number(float(found.min()))} and {_number(float(found.max()), unit)}"
        texts.append(f"{line.name[:1].upper()}{line.name[1:]}: {ends}.")
    return " ".join(texts)


def of_flow(into: dict[str, float], out: dict[str, float]) -> str:
    """Return from where most power comes, and where most of it goes."""
    if not into or not out:
        return "No power flows."
    source, sink = (max(group, key=lambda name: group[name]) for group in (into, out))
    return (
        f"{_number(sum(into.values()), 'W')} come in, most by {source}; "
        f"{_number(out[sink], 'W')} go to: {sink}."
    )


def _number(value: float, unit: str = "") -> str:
    return f"{number(value)} {unit}".rstrip()


def _greatest_change(envelope: Envelope, marks: Sequence[Mark]) -> _Change | None:
    """Return the greatest change of the mean from one side of a mark to the other.

    Each side reaches to the next mark. Without one that is worth a word: the change from the first
    to the last fifth of the time.
    """
    used = np.flatnonzero(envelope.count)
    if len(used) < 2 * _FEWEST:
        return None
    times, means = envelope.times[used], envelope.total[used] / envelope.count[used]
    moments = sorted(_moments(marks))
    # A part of the time belongs to one side only if it ends before the moment, or begins after it.
    half = 0.5 * envelope.width
    edges = [-math.inf, *(time for time, _ in moments), math.inf]
    found = []
    for place, (time, reason) in enumerate(moments):
        before = means[(times >= edges[place] + half) & (times <= time - half)]
        after = means[(times >= time + half) & (times <= edges[place + 2] - half)]
        if _worth_a_word(before, after):
            found.append(_Change(float(before.mean()), float(after.mean()), time, reason))
    if found:
        return max(found, key=lambda change: abs(change.after - change.before))
    fifth = max(len(means) // 5, _FEWEST)
    if _worth_a_word(means[:fifth], means[-fifth:]):
        last = float(times[-fifth])
        return _Change(float(means[:fifth].mean()), float(means[-fifth:].mean()), last, "")
    return None


def _moments(marks: Sequence[Mark]) -> Iterator[tuple[float, str]]:
    for mark in marks:
        if mark.kind == COMMAND:
            yield mark.time, f", with the command {mark.text}"
        elif mark.kind == FAULT:
            yield mark.time, f", when the fault {mark.text} begins"
            if mark.end is not None:
                yield mark.end, f", when the fault {mark.text} ends"


def _worth_a_word(before: np.ndarray, after: np.ndarray) -> bool:
    if len(before) < _FEWEST or len(after) < _FEWEST:
        return False
    change = abs(float(after.mean() - before.mean()))
    greatest = max(abs(float(before.mean())), abs(float(after.mean())))
    error = math.sqrt(before.var(ddof=1) / len(before) + after.var(ddof=1) / len(after))
    return change > _LEAST_CHANGE * greatest and change > _LEAST_SCORE * error
