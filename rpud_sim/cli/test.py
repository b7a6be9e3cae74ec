"""``rpud test``: verdicts on the expectations of a file, over a bag or in a campaign."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.campaign import SUFFIXES, add_campaign_arguments, test_campaign
from rpud_sim.cli.options import add_json_argument
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.verdicts import Record, Verdict

HELP = "judge a bag by the expectations of a file, or fly a campaign of tests"
DETAILS = (
    "Each expectation is passed, failed or undecided. The last run in a bag is judged. "
    "A campaign flies scenarios, parameters and seeds against a system under test. "
    "Exit codes: 0 all passed, 1 one failed or is undecided, 2 wrong call. A requirement of a "
    "campaign is undecided if no run decides it."
)
EXAMPLE = "rpud test bags/first --expect config/expectations.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "subject",
        metavar="BAG|CAMPAIGN",
        help="a bag's folder or one file of it, or a campaign file that ends in .yaml",
    )
    parser.add_argument("--expect", metavar="FILE", help="expectations, as in docs/reference")
    parser.add_argument(
        "--namespace", metavar="NAME", help="of the drill, where the bag holds several"
    )
    parser.add_argument("--junit", metavar="FILE", help="write a JUnit XML file as well")
    add_campaign_arguments(parser)
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    if Path(arguments.subject).suffix in SUFFIXES and not Path(arguments.subject).is_dir():
        return test_campaign(arguments)
    if arguments.expect is None:
        raise CommandError("a bag needs --expect FILE; see rpud test --help", ExitCode.USAGE)
    return _test_bag(arguments)


def _test_bag(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.verdicts import Record, evaluate, read_expectations
    from rpud_sim.verdicts.bag_check import check_bag
    from rpud_sim.verdicts.junit import junit_xml

    expectations = read_expectations(arguments.expect)
    topics = sorted({topic for each in expectations for topic in each.topics})
    with failing(BagError):
        check_bag(arguments.subject, expectations, arguments.namespace, arguments.expect)
        with progress_bar(" messages", scaled=True) as bar:
            record = Record.from_bag(arguments.subject, topics, arguments.namespace, bar.update)
    verdicts = [evaluate(each, record) for each in expectations]
    for topic in topics:
        if lost := record.missing(topic).total:
            complain("rpud test", f"{lost} messages of {topic} are lost")
    if arguments.junit:
        Path(arguments.junit).write_text(junit_xml(verdicts, arguments.subject), encoding="utf-8")
    print_json(_content(verdicts, record)) if arguments.json else print(_account(verdicts, record))
    return ExitCode.DONE if all(each.passed for each in verdicts) else ExitCode.FAILED


def _counts(verdicts: list[Verdict]) -> dict[str, int]:
    from rpud_sim.verdicts.verdict import OUTCOMES

    return {outcome: sum(each.outcome == outcome for each in verdicts) for outcome in OUTCOMES}


def _content(verdicts: list[Verdict], record: Record) -> dict[str, Any]:
    return {
        "passed": all(each.passed for each in verdicts),
        "counts": _counts(verdicts),
        "runs": record.runs,
        "verdicts": [each.to_dict() for each in verdicts],
    }


def _account(verdicts: list[Verdict], record: Record) -> str:
    head = ("requirement", "name", "verdict", "margin", "at [s]", "reaction [s]")
    rows = [
        (
            each.requirement or "-",
            each.name,
            each.outcome,
            "-" if each.margin is None else f"{each.margin:.4g} {each.unit}".rstrip(),
            "-" if each.at is None else f"{each.at:.3f}",
            "-" if each.reaction_time is None else f"{each.reaction_time:.3f}",
        )
        for each in verdicts
    ]
    lines = table(head, rows, left=3)
    undecided = [
        f"undecided: {printable(each.name)}: {printable(each.text)}"
        for each in verdicts
        if each.outcome == "undecided"
    ]
    counts = ", ".join(f"{count} {outcome}" for outcome, count in _counts(verdicts).items())
    if record.runs > 1:
        counts += f"; of {record.runs} runs in the bag, the last"
    return "\n".join([*lines, "", *undecided, counts])
