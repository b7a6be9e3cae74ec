"""Verdicts: what an expectation comes to on a record, and their JUnit XML."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts.evaluation import Evaluation
from rpud_sim.verdicts.formulas import (
    After,
    And,
    Compare,
    Count,
    Eventually,
    Formula,
    Quantile,
    Says,
    Until,
)
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.notation import to_plain
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.steps import LEAST_MARGIN, LEAST_TRUTH, MOST_MARGIN, MOST_TRUTH
from rpud_sim.verdicts.units import WHOLE, unit_factor

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
    margin: float | None = None
    unit: str = ""  # of the margin
    # simulation time at which it was broken, fulfilled or over [s]; None if undecided
    at: float | None = None
    # longest time from an event of ``after`` to the instant at which what follows was
    # fulfilled [s]; None if it has none, or if it never was
    reaction_time: float | None = None
    text: str = ""  # why, in one line

    @property
    def passed(self) -> bool:
        """Whether it passed; neither failed nor undecided."""
        return self.outcome == PASSED

    def to_dict(self) -> dict[str, Any]:
        """Return the content for JSON, in which no number is infinite."""
        return {**dataclasses.asdict(self), "passed": self.passed}


def evaluate(expectation: Expectation, record: Record) -> Verdict:
    """Return the verdict on an expectation."""
    about = expectation.name, expectation.requirement
    formula = expectation.formula
    missing = "; ".join(filter(None, map(record.note, expectation.used_topics)))
    span = record.span(expectation.topics)
    if span is None:
        return Verdict(*about, UNDECIDED, text=missing or "the record has no message")
    begin, end = span
    zero = record.zero(expectation.topics)
    evaluation = Evaluation(record, begin, end, zero)
    steps = evaluation.steps(formula, once=True)
    least, most = (float(steps.values[row, 0]) for row in (LEAST_TRUTH, MOST_TRUTH))
    if steps.absent[0] or least < 0.0 < most:
        text = missing or _why_undecided(expectation, evaluation, record, zero)
        return Verdict(*about, UNDECIDED, text=text)
    held = least > 0.0
    margin = float(steps.values[LEAST_MARGIN if held else MOST_MARGIN, 0])
    at = (evaluation.decided(formula, begin, held) - zero) / SECOND
    reaction = _reaction(evaluation, formula)
    units = _units(formula, record) if math.isfinite(margin) else set()
    return Verdict(
        *about,
        PASSED if held else FAILED,
        margin + 0.0 if math.isfinite(margin) else None,
        MIXED if len(units) > 1 else "".join(units),
        at,
        None if reaction is None else reaction / SECOND,
        f"{'held' if held else 'broken'} at {at:.9g} s",
    )


def _why_undecided(
    expectation: Expectation, evaluation: Evaluation, record: Record, zero: int
) -> str:
    for topic in expectation.used_topics:
        lost = record.missing(topic).total
        if lost:
            return f"{lost} messages of {topic} are lost"
    for part in expectation.formula.walk():
        if isinstance(part, After) and not evaluation.trigger(part.trigger).sure(evaluation.begin):
            return f"the event of after never came: {to_plain(part.trigger)}"
    over = f"the record ends at {(evaluation.end - zero) / SECOND:.9g} s, before it is decided"
    for part in expectation.formula.walk():
        if isinstance(part, (Compare, Says)) and (gap := _gap(evaluation, part)) is not None:
            silent = f"{part.signal} has no value at {(gap - zero) / SECOND:.9g} s"
            windows = [getattr(each, "window", WHOLE) for each in expectation.formula.walk()]
            return silent if set(windows) == {WHOLE} else f"{silent}, or {over}"
    return over


def _gap(evaluation: Evaluation, part: Formula) -> int | None:
    """Return when a signal was silent for longer than it holds, or not a number [ns]."""
    steps = evaluation.steps(part)
    unknown = (steps.values[LEAST_TRUTH] < 0.0) & (steps.values[MOST_TRUTH] > 0.0)
    found = steps.starts[unknown & ~steps.absent & (steps.starts <= evaluation.end)]
    return int(found[0]) if len(found) else None


def _units(formula: Formula, record: Record) -> set[str]:
    """Return the SI units in which the comparisons of a formula have their margins."""
    if isinstance(formula, Count):  # its margin is a number, whatever its events are
        return {""}
    if isinstance(formula, (Compare, Quantile)):
        field = record.field(formula.signal)
        return {(field.unit if field else "") or unit_factor(formula.number.unit)[1]}
    return set().union(*(_units(part, record) for part in formula.children()))


def _reaction(evaluation: Evaluation, formula: Formula) -> int | None:
    """Return the longest time from an event to the fulfilment of what must follow it [ns]."""
    longest: int | None = None
    for part in formula.walk():
        if not isinstance(part, After):
            continue
        for goal in _goals(part.formula):
            trigger, steps = evaluation.trigger(part.trigger), evaluation.steps(goal)
            for instant in trigger.sure(evaluation.begin):
                found = steps.first(instant, evaluation.end, True)
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


def junit_xml(verdicts: Sequence[Verdict], suite: str) -> str:
    """Return a JUnit test suite, a case for each verdict: failed fails, undecided is an error."""
    counts = {
        name: str(sum(each.outcome == outcome for each in verdicts))
        for name, outcome in (("failures", FAILED), ("errors", UNDECIDED))
    }
    attributes = {"name": printable(suite), "tests": str(len(verdicts)), **counts}
    root = ElementTree.Element("testsuites")
    node = ElementTree.SubElement(root, "testsuite", attributes)
    for verdict in verdicts:
        node.append(_case(verdict, printable(suite)))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def _case(verdict: Verdict, suite: str) -> ElementTree.Element:
    case = ElementTree.Element("testcase", {"classname": suite, "name": printable(verdict.name)})
    properties = ElementTree.SubElement(case, "properties")
    values = {
        "requirement": verdict.requirement,
        "margin": "" if verdict.margin is None else f"{verdict.margin:.9g} {verdict.unit}".strip(),
        "at": "" if verdict.at is None else f"{verdict.at:.9g} s",
        "reaction_time": "" if verdict.reaction_time is None else f"{verdict.reaction_time:.9g} s",
    }
    for name, value in values.items():
        if value:
            ElementTree.SubElement(properties, "property", {"name": name, "value": value})
    if verdict.outcome in (FAILED, UNDECIDED):
        tag = "failure" if verdict.outcome == FAILED else "error"
        text = f"{verdict.outcome}: {printable(verdict.text)}"
        ElementTree.SubElement(case, tag, {"message": text, "type": verdict.outcome})
    return case
