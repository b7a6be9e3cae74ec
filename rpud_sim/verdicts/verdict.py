"""Verdicts: what an expectation comes to on a record."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts.atoms import Atoms
from rpud_sim.verdicts.expectation import Expectation
from rpud_sim.verdicts.names import Field, unit_of
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.robustness import Evaluation
from rpud_sim.verdicts.steps import LEAST_MARGIN, LEAST_TRUTH, MOST_MARGIN, MOST_TRUTH, Steps
from rpud_sim.verdicts.vocabulary import (
    After,
    Always,
    And,
    Compare,
    Count,
    Eventually,
    Formula,
    Implies,
    Not,
    Or,
    Quantile,
    Until,
    Window,
)

PASSED, FAILED, UNDECIDED = "passed", "failed", "undecided"
OUTCOMES = (PASSED, FAILED, UNDECIDED)

MIXED = "mixed units"  # unit of a margin to which comparisons in several units contribute


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Verdict on an expectation."""

    name: str  # of the expectation
    requirement: str  # its identifier; empty for none
    outcome: str  # one of ``OUTCOMES``
    # by how much it holds, or fails where it is negative; None if it is undecided, or if no
    # number decides it
    margin: float | None
    unit: str  # of the margin
    # simulation time at which it was broken, fulfilled or over [s]; None if undecided
    at: float | None
    # longest time from an event of ``after`` to the instant at which what follows was
    # fulfilled [s]; None if it has none, or if it never was
    reaction_time: float | None
    text: str  # why, in one line

    @property
    def passed(self) -> bool:
        """Whether it passed; neither failed nor undecided."""
        return self.outcome == PASSED

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON, in which no number is infinite."""
        return {**dataclasses.asdict(self), "passed": self.passed}


def evaluate(expectation: Expectation, record: Record) -> Verdict:
    """Return the verdict on an expectation."""
    notes = [record.note(topic) for topic in expectation.used_topics]
    missing = "; ".join(note for note in notes if note)
    span = record.span(expectation.topics)
    if span is None:
        text = missing or "the record has no message"
        return _verdict(expectation, UNDECIDED, text=text)
    begin, end = span
    zero = record.zero(expectation.topics)
    evaluation = Evaluation(Atoms(record, begin, end, zero))
    steps = evaluation.steps(expectation.formula, once=True)
    least, most = (float(steps.values[row, 0]) for row in (LEAST_TRUTH, MOST_TRUTH))
    if steps.absent[0] or least < 0.0 < most:
        text = missing or _why_undecided(expectation, record, end, zero)
        return _verdict(expectation, UNDECIDED, text=text)
    held = least > 0.0
    margin = float(steps.values[LEAST_MARGIN if held else MOST_MARGIN, 0])
    at = _decided(evaluation, expectation.formula, begin, held)
    reaction = _reaction(evaluation, expectation.formula)
    return _verdict(
        expectation,
        PASSED if held else FAILED,
        margin + 0.0 if math.isfinite(margin) else None,
        _unit(expectation.formula, record) if math.isfinite(margin) else "",
        (at - zero) / SECOND,
        None if reaction is None else reaction / SECOND,
        ("held" if held else "broken") + f" at {(at - zero) / SECOND:.9g} s",
    )


def _verdict(
    expectation: Expectation,
    outcome: str,
    margin: float | None = None,
    unit: str = "",
    at: float | None = None,
    reaction_time: float | None = None,
    text: str = "",
) -> Verdict:
    return Verdict(
        expectation.name,
        expectation.requirement,
        outcome,
        margin,
        unit,
        at,
        reaction_time,
        text,
    )


def _why_undecided(expectation: Expectation, record: Record, end: int, zero: int) -> str:
    for topic in expectation.used_topics:
        lost = record.missing(topic).total
        if lost:
            return f"{lost} messages of {topic} are lost"
    triggers = [part for part in expectation.formula.walk() if isinstance(part, After)]
    over = f"the record ends at {(end - zero) / SECOND:.9g} s, before it is decided"
    return f"{over}, or the event of after never came" if triggers else over


def _unit(formula: Formula, record: Record) -> str:
    units = _units(formula, record)
    return MIXED if len(units) > 1 else "".join(units)


def _units(formula: Formula, record: Record) -> set[str]:
    if isinstance(formula, Count):  # a number, whatever is compared in its event
        return {""}
    if isinstance(formula, (Compare, Quantile)):
        field = record.field(formula.signal)
        return {unit_of(formula.number, field if isinstance(field, Field) else None)}
    return set().union(*(_units(child, record) for child in formula.children()))


def _decided(evaluation: Evaluation, formula: Formula, time: int, held: bool) -> int:
    """Return the instant at which it shows that a formula holds at a time, or does not [ns]."""
    end = evaluation.end
    if isinstance(formula, Not):
        return _decided(evaluation, formula.formula, time, not held)
    if isinstance(formula, Implies):
        formula = Or((Not(formula.condition), formula.formula))
    if isinstance(formula, (And, Or)):
        times = [
            _decided(evaluation, part, time, held)
            for part in formula.formulas
            if _is(evaluation.steps(part, once=time == evaluation.begin), time, held)
        ]
        every = held is isinstance(formula, And)
        return (max if every else min)(times, default=time)
    if isinstance(formula, (Always, Eventually)):
        last = _last(formula.window, time, end)
        if held is isinstance(formula, Always):
            return last
        steps = evaluation.steps(formula.formula)
        found = _first(steps, time + formula.window.start, last, held)
        return last if found is None else _decided(evaluation, formula.formula, found, held)
    if isinstance(formula, After):
        return end if held else _broken_after(evaluation, formula, time)
    if isinstance(formula, Until):
        last = _last(formula.window, time, end)
        part, begin = (
            (formula.goal, time + formula.window.start) if held else (formula.formula, time)
        )
        found = _first(evaluation.steps(part), begin, last, held)
        return last if found is None else _decided(evaluation, part, found, held)
    if isinstance(formula, (Count, Quantile)):
        return _last(formula.window, time, end)
    return time


def _broken_after(evaluation: Evaluation, formula: After, time: int) -> int:
    trigger, then = evaluation.steps_of_after(formula)
    for instant in _sure(trigger, time):
        if _is(then, instant, False):
            return _decided(evaluation, formula.formula, instant, False)
    return evaluation.end


def _reaction(evaluation: Evaluation, formula: Formula) -> int | None:
    """Return the longest time from an event to the fulfilment of what must follow it [ns]."""
    longest: int | None = None
    for part in formula.walk():
        if not isinstance(part, After):
            continue
        for goal in _goals(part.formula):
            trigger, steps = evaluation.trigger(part.trigger), evaluation.steps(goal)
            for instant in _sure(trigger, evaluation.begin):
                found = _first(steps, instant, evaluation.end, True)
                if found is None:
                    return None
                longest = max(longest or 0, found - instant)
    return longest


def _goals(formula: Formula) -> list[Formula]:
    """Return what must come some time: the formulas in eventually and the goals of until."""
    if isinstance(formula, Eventually):
        return [formula.formula]
    if isinstance(formula, Until) and not formula.weak:
        return [formula.goal]
    if isinstance(formula, And):
        return [goal for part in formula.formulas for goal in _goals(part)]
    return []


def _last(window: Window, time: int, end: int) -> int:
    return end if window.end is None else min(time + window.end, end)


def _is(steps: Steps, time: int, held: bool) -> bool:
    number = int(steps.at(np.array([time]))[0])
    values = steps.values[:, number]
    return bool(values[LEAST_TRUTH] > 0.0 if held else values[MOST_TRUTH] < 0.0)


def _first(steps: Steps, begin: int, end: int, held: bool) -> int | None:
    """Return the first instant of a span at which a formula surely holds, or does not [ns]."""
    chosen = steps.values[LEAST_TRUTH] > 0.0 if held else steps.values[MOST_TRUTH] < 0.0
    chosen = chosen & ~steps.absent
    first = max(int(steps.at(np.array([begin]))[0]), 0)
    found = np.flatnonzero(chosen[first:])
    if not len(found):
        return None
    instant = max(int(steps.starts[first + found[0]]), begin)
    return instant if instant <= end else None


def _sure(trigger: Steps, begin: int) -> list[int]:
    chosen = (trigger.values[LEAST_TRUTH] > 0.0) & (trigger.starts >= begin)
    return [int(start) for start in trigger.starts[chosen]]
