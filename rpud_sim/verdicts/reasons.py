"""Reasons of verdicts in words: what the signals were, what came too late, what is not known."""

from __future__ import annotations

import math
from collections.abc import Iterable

import rpud_sim.verdicts.formulas as f
from rpud_sim.verdicts.decisions import Reason
from rpud_sim.verdicts.evaluation import Evaluation
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.notation import to_text
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.steps import LEAST_TRUTH, MOST_TRUTH
from rpud_sim.verdicts.units import WHOLE, Window, duration_text, find_unit

# Why a formula is undecided whose event has not come; the event follows after a colon.
NO_EVENT = "the event of after never came"


def described(evaluation: Evaluation, reasons: Iterable[Reason]) -> str:
    """Return the reasons of a decision as one line; empty if there is nothing to report."""
    texts = dict.fromkeys(_described(evaluation, reason) for reason in reasons)
    return "; ".join(filter(None, texts))


def why_undecided(expectation: Expectation, evaluation: Evaluation) -> str:
    """Return why a formula is undecided, as one line."""
    for topic in expectation.used_topics:
        lost = evaluation.record.missing(topic).total
        if lost:
            return f"{lost} messages of {topic} are lost"
    for part in expectation.formula.walk():
        if isinstance(part, f.After) and not evaluation.trigger(part.trigger).sure(
            evaluation.begin
        ):
            return f"{NO_EVENT}: {to_text(part.trigger)}"
    over = f"the record ends at {_at(evaluation, evaluation.end)}, before it is decided"
    for part in expectation.formula.walk():
        if isinstance(part, f.Compare | f.HasText) and (gap := _gap(evaluation, part)) is not None:
            silent = f"{part.signal} has no value at {_at(evaluation, gap)}"
            windows = [getattr(each, "window", WHOLE) for each in expectation.formula.walk()]
            return silent if set(windows) == {WHOLE} else f"{silent}, or {over}"
    return over


def unit_of(record: Record, part: f.Compare | f.Quantile) -> str:
    """Return the SI unit of what a formula compares."""
    field = record.field(part.signal)
    return (field.unit if field else "") or find_unit(part.number.unit).si


def _gap(evaluation: Evaluation, part: f.Formula) -> int | None:
    """Return when a signal was silent for longer than it holds, or not a number [ns]."""
    steps = evaluation.steps(part)
    unknown = (steps.values[LEAST_TRUTH] < 0.0) & (steps.values[MOST_TRUTH] > 0.0)
    found = steps.starts[unknown & ~steps.absent & (steps.starts <= evaluation.end)]
    return int(found[0]) if len(found) else None


def _described(evaluation: Evaluation, reason: Reason) -> str:
    part, time, held = reason
    match part:
        case f.Compare() | f.HasText() | f.Count() | f.Quantile():
            return _with_value(evaluation, part, time)
        case f.Eventually(goal, window) if not held:
            return _lateness(evaluation, goal, window, time)
        case f.Until(_, goal, window) if not held:
            return _lateness(evaluation, goal, window, time)
        case f.Event():
            return f"{to_text(part)} came at {_at(evaluation, time)}" if held else ""
    return f"{to_text(part)} {'held' if held else 'did not hold'} at {_at(evaluation, time)}"


def _with_value(evaluation: Evaluation, part: f.SignalFormula | f.Count, time: int) -> str:
    value = _measured(evaluation, part, time)
    if isinstance(part, f.Compare | f.HasText):
        verb = f"was {value}" if value else "has no value"
        return f"{part.signal} {verb} at {_at(evaluation, time)}"
    if not value:
        return ""
    span = _span(evaluation, part.window, time)
    if isinstance(part, f.Count):
        return f"{to_text(part.event)} came {value} times {span}"
    return f"quantile {part.share:g} of {part.signal} was {value} {span}"


def _lateness(evaluation: Evaluation, goal: f.Formula, window: Window, time: int) -> str:
    """Return how late a goal came that a window after a time [ns] awaited."""
    last = window.last(time, evaluation.end)
    came = evaluation.steps(goal).first(last + 1, evaluation.end, True)
    if came is None:
        rest = _span(evaluation, Window(window.start), time)
        return f"{to_text(goal)} never came in the record {rest}"
    late = duration_text(came - last)
    return f"{to_text(goal)} came {late} too late, at {_at(evaluation, came)}"


def _measured(evaluation: Evaluation, part: f.SignalFormula | f.Count, time: int) -> str:
    """Return what a formula compares at a time [ns]; empty if it is not known."""
    found = evaluation.measured(part, time)
    if found is None:
        return ""
    low, high = found
    if isinstance(part, f.HasText):
        return low if isinstance(low, str) else str(bool(low)).lower()
    if isinstance(part, f.Count):
        return _between(float(low), float(high), part.number)
    limit = evaluation.threshold(part.number, part.signal)
    value = _between(float(low), float(high), limit)
    return f"{value} {unit_of(evaluation.record, part)}".rstrip() if value else ""


def _between(low: float, high: float, limit: float) -> str:
    least, most = (_number(value, limit) for value in (low, high))
    if low == high:
        return least
    if math.isinf(low):
        return "" if math.isinf(high) else f"at most {most}"
    return f"at least {least}" if math.isinf(high) else f"{least} to {most}"


def _number(value: float, limit: float) -> str:
    """Return a number as short text that is on the same side of a limit."""
    text = f"{value:.6g}"
    short = float(text)
    same = (short < limit, short > limit) == (value < limit, value > limit)
    return text if same else repr(value)


def _at(evaluation: Evaluation, time: int) -> str:
    return f"{evaluation.seconds(time):.9g} s"


def _span(evaluation: Evaluation, window: Window, time: int) -> str:
    """Return a window after a time [ns] in words."""
    last = window.last(time, evaluation.end)
    return f"from {_at(evaluation, time + window.start)} until {_at(evaluation, last)}"
