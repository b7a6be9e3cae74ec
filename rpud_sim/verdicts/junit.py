"""JUnit XML of verdicts, which CI servers show."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

from rpud_sim.foundation.terminal import printable
from rpud_sim.verdicts.verdict import FAILED, UNDECIDED, Verdict


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
