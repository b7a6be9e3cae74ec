"""Verdicts: what an expectation comes to on a record, and their JUnit XML."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.time import SECOND
from rpud_sim.verdicts.decisions import Decision, decide
from rpud_sim.verdicts.evaluation import Evaluation
from rpud_sim.verdicts.formulas import (
    After,
    And,
    Compare,
    Count,
    Eventually,
    Formula,
    Quantile,
    Until,
)
from rpud_sim.verdicts.names import Expectation
from rpud_sim.verdicts.notation import to_text
from rpud_sim.verdicts.reasons import described, unit_of, why_undecided
from rpud_sim.verdicts.record import Record
from rpud_sim.verdicts.steps import LEAST_MARGIN, LEAST_TRUTH, MOST_MARGIN, MOST_TRUTH

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
    evaluation = Evaluation(record, begin, end, record.zero(expectation.topics))
    steps = evaluation.steps(formula, once=True)
    least, most = (float(steps.values[row, 0]) for row in (LEAST_TRUTH, MOST_TRUTH))
    if steps.absent[0] or least < 0.0 < most:
        text = missing or why_undecided(expectation, evaluation)
        return Verdict(*about, UNDECIDED, text=text)
    held = least > 0.0
    margin = float(steps.values[LEAST_MARGIN if held else MOST_MARGIN, 0])
    decision = decide(evaluation, formula, begin, held)
    at = evaluation.seconds(decision.time)
    reaction = _reaction(evaluation, formula)
    units = _units(formula, record) if math.isfinite(margin) else set()
    return Verdict(
        *about,
        PASSED if held else FAILED,
        margin + 0.0 if math.isfinite(margin) else None,
        MIXED if len(units) > 1 else "".join(units),
        at,
        None if reaction is None else reaction / SECOND,
        f"held at {at:.9g} s" if held else _why_failed(expectation, evaluation, decision),
    )


def latest_values(expectation: Expectation, record: Record) -> str:
    """Return the latest values of the signals of a formula that does not hold, as one line."""
    span = record.span(expectation.topics)
    if span is None:
        return ""
    evaluation = Evaluation(record, *span, record.zero(expectation.topics))
    return described(evaluation, decide(evaluation, expectation.formula, span[1], False).reasons)


def _why_failed(expectation: Expectation, evaluation: Evaluation, decision: Decision) -> str:
    """Return what the signals were, how late it was, and what was required, unless the name is."""
    at = evaluation.seconds(decision.time)
    text = described(evaluation, decision.reasons) or f"broken at {at:.9g} s"
    required = to_text(expectation.formula)
    return text if expectation.name == required else f"{text}; required: {required}"


def _units(formula: Formula, record: Record) -> set[str]:
    """Return the SI units in which the comparisons of a formula have their margins."""
    if isinstance(formula, Count):  # its margin is a number, whatever its events are
        return {""}
    if isinstance(formula, (Compare, Quantile)):
        return {unit_of(record, formula)}
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
