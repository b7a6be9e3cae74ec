"""Decisions: at which instant of a recording a formula is decided, and which of its parts do it."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import rpud_sim.verdicts.formulas as f
from rpud_sim.verdicts.evaluation import Evaluation, event_of


class Reason(NamedTuple):
    """Part of a formula that decides it."""

    part: f.Formula
    time: int  # at which the part is looked at [ns]
    held: bool  # whether it held then


class Decision(NamedTuple):
    """Instant at which a formula is decided, and what decides it."""

    time: int  # [ns]
    reasons: tuple[Reason, ...] = ()


def decide(evaluation: Evaluation, formula: f.Formula, time: int, held: bool) -> Decision:
    """Return when and by what it shows that a formula holds at a time [ns], or does not."""
    itself = Reason(formula, time, held)
    match formula:
        case f.Not(inner):
            return decide(evaluation, inner, time, not held)
        case f.And(parts) | f.Or(parts):
            return _of_several(evaluation, parts, time, held, held is (type(formula) is f.And))
        case f.Implies(condition, then):
            return decide(evaluation, f.Or((f.Not(condition), then)), time, held)
        case f.Always(inner, window) | f.Eventually(inner, window):
            last = window.last(time, evaluation.end)
            if held is (type(formula) is f.Always):
                return _at_last(evaluation, inner, last, itself)
            return _first(evaluation, inner, time + window.start, last, itself)
        case f.Until(inner, goal, window):
            last = window.last(time, evaluation.end)
            if held:
                return _first(evaluation, goal, time + window.start, last, itself)
            if evaluation.steps(inner).first(time, last, False) is None:
                return _at_last(evaluation, goal, last, itself)
            return _first(evaluation, inner, time, last, itself)
        case f.After(trigger, then):
            instants = [] if held else evaluation.trigger(trigger).sure(time)
            broken = (each for each in instants if evaluation.steps(then).shows(each, False))
            if (instant := next(broken, None)) is None:
                return Decision(evaluation.end, (itself,))
            at, reasons = decide(evaluation, then, instant, False)
            return Decision(at, (Reason(event_of(trigger), instant, True), *reasons))
        case f.Count(window=window) | f.Quantile(window=window):
            return Decision(window.last(time, evaluation.end), (itself,))
    return Decision(time, (itself,))


def _of_several(
    evaluation: Evaluation, parts: tuple[f.Formula, ...], time: int, held: bool, every: bool
) -> Decision:
    """Return the decision of several parts: of ``every`` one, or of those that are first."""
    once = time == evaluation.begin
    shown = [part for part in parts if evaluation.steps(part, once).shows(time, held)]
    found = [decide(evaluation, part, time, held) for part in shown]
    at = (max if every else min)((each.time for each in found), default=time)
    deciding = [each.reasons for each in found if every or each.time == at]
    return Decision(at, tuple(chain.from_iterable(deciding)))


def _first(
    evaluation: Evaluation, part: f.Formula, begin: int, last: int, whole: Reason
) -> Decision:
    """Return when it shows first in a span that a part holds, or does not; or the span's end."""
    found = evaluation.steps(part).first(begin, last, whole.held)
    if found is None:
        return Decision(last, (whole,))
    return decide(evaluation, part, found, whole.held)


def _at_last(evaluation: Evaluation, part: f.Formula, last: int, whole: Reason) -> Decision:
    """Return the end of a window in which a part held always, or never."""
    present = () if whole.held else decide(evaluation, part, last, False).reasons
    return Decision(last, (*present, whole))
