"""JUnit XML of a campaign: a suite for each run, a case for each verdict."""

from __future__ import annotations

from xml.etree import ElementTree

from rpud_sim.foundation.terminal import printable
from rpud_sim.testing.campaign.outcome import SYSTEM
from rpud_sim.testing.campaign.results import FlownRun, Results
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, UNDECIDED


def campaign_junit(results: Results) -> str:
    """Return the XML; an undecided verdict is a skipped case."""
    root = ElementTree.Element("testsuites", {"name": printable(results.campaign.name)})
    for flown in results.runs:
        root.append(_suite(flown))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def _suite(flown: FlownRun) -> ElementTree.Element:
    outcome = flown.outcome
    name = printable(flown.run.name)
    suite = ElementTree.Element(
        "testsuite",
        {
            "name": name,
            "tests": str(len(outcome.verdicts)),
            "failures": str(sum(each.outcome == FAILED for each in outcome.verdicts)),
            "errors": "0",
            "skipped": str(sum(each.outcome == UNDECIDED for each in outcome.verdicts)),
            "time": f"{outcome.wall_time:.3f}",
        },
    )
    values = {"bag": flown.bag, "ending": outcome.ending, "digest": outcome.digest}
    suite.append(_properties(values))
    suite.extend(_case(verdict, flown) for verdict in outcome.verdicts)
    return suite


def _case(verdict: Verdict, flown: FlownRun) -> ElementTree.Element:
    case = ElementTree.Element(
        "testcase",
        {
            "classname": printable(verdict.requirement or verdict.name),
            "name": printable(f"{verdict.name} [{flown.run.name}]"),
            "time": f"{flown.outcome.wall_time / len(flown.outcome.verdicts):.3f}",
        },
    )
    margin, reaction = verdict.margin, verdict.reaction_time
    case.append(
        _properties(
            {
                "requirement": verdict.requirement,
                "margin": "" if margin is None else f"{margin:.9g} {verdict.unit}".rstrip(),
                "at": "" if verdict.at is None else f"{verdict.at:.9g} s",
                "reaction_time": "" if reaction is None else f"{reaction:.9g} s",
                "bag": flown.bag,
            }
        )
    )
    if verdict.outcome == UNDECIDED:
        ElementTree.SubElement(case, "skipped", {"message": printable(verdict.text)})
    elif verdict.outcome == FAILED:
        kind = flown.outcome.ending if verdict.name == SYSTEM else FAILED
        attributes = {"message": printable(verdict.text), "type": kind}
        failure = ElementTree.SubElement(case, "failure", attributes)
        lines = flown.outcome.text.splitlines() if verdict.name == SYSTEM else [verdict.text]
        failure.text = "\n".join(printable(line) for line in lines)
    return case


def _properties(values: dict[str, str]) -> ElementTree.Element:
    properties = ElementTree.Element("properties")
    for name, value in values.items():
        if value:
            ElementTree.SubElement(
                properties, "property", {"name": name, "value": printable(value)}
            )
    return properties
