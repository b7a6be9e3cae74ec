"""``rpud test``: verdicts on the expectations of a file, over a bag or in a campaign."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import command
from rpud_sim.cli.output import print_json, progress_bar, table
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.foundation.options import option, positional
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.foundation.whole_folder import whole_file

if TYPE_CHECKING:
    from rpud_sim.testing.campaign_results import CampaignResults
    from rpud_sim.verdicts import Record, Verdict

SUFFIXES = (".yaml", ".yml")
"""Suffixes of campaign files: any other file or folder is a bag."""

# The package was imported before pytest could rewrite it; its tests do not need that.
_QUIET = ("-W", "ignore::pytest.PytestAssertRewriteWarning")


@dataclass(frozen=True, kw_only=True)
class _Test:
    subject: str = positional(
        "BAG|CAMPAIGN",
        "a bag's folder or one file of it, or a campaign file that ends in .yaml",
    )
    expect: str | None = option(None, "expectations, as in docs/reference", metavar="FILE")
    namespace: str | None = option(
        None, "of the drill, where the bag holds several", metavar="NAME"
    )
    junit: str | None = option(None, "write a JUnit XML file as well", metavar="FILE")
    json: bool = option(False, "print one JSON object")
    out: str | None = option(
        None,
        "folder for page, bags and logs (default: rpud-artefacts)",
        metavar="DIR",
        group="campaigns",
    )
    only: str | None = option(
        None, "fly these runs only: -k of pytest", metavar="EXPRESSION", group="campaigns"
    )
    further: Sequence[str] = ()  # words for pytest


@command(
    "test",
    "bags/first --expect config/expectations.yaml",
    "judge a bag by the expectations of a file, or fly a campaign of tests",
    _Test,
    "Each expectation is passed, failed or undecided. The last run in a bag is judged. "
    "A campaign flies scenarios, parameters and seeds against a system under test, by pytest, "
    "which gets all further options, such as -n 4 or --lf. "
    "Exit codes: 0 all passed, 1 one is undecided, or a drill failed, 2 wrong call, 3 one failed.",
)
def _run(options: _Test) -> int:
    if Path(options.subject).suffix in SUFFIXES and not Path(options.subject).is_dir():
        return _test_campaign(options)
    if options.expect is None:
        raise CommandError("a bag needs --expect FILE; see rpud test --help", ExitCode.USAGE)
    if options.further:
        words = printable(" ".join(options.further))
        raise CommandError(f"unrecognized arguments: {words}", ExitCode.USAGE)
    return _test_bag(options, options.expect)


def _test_campaign(options: _Test) -> int:
    """Call pytest on a campaign; return the exit code."""
    for name in ("expect", "namespace", "json"):
        if getattr(options, name):
            raise CommandError(f"--{name} is for bags", ExitCode.USAGE)
    import pytest

    # Where a package is missing, this fails in one line, and pytest would not.
    import rpud_sim.testing.campaign_runs  # noqa: F401
    from rpud_sim.testing.campaign_file import read_campaign
    from rpud_sim.testing.campaign_session import NAME

    class Listener:
        """Plugin that takes the results out of the session."""

        campaigns: tuple[CampaignResults, ...] = ()

        @pytest.hookimpl(trylast=True)
        def pytest_sessionfinish(self, session: pytest.Session) -> None:
            plugin: Any = session.config.pluginmanager.get_plugin(NAME)
            self.campaigns = tuple(plugin.results.values())

    read_campaign(options.subject)  # a mistake is one line
    words = [options.subject, "--rpud-keep", *_QUIET, *options.further]
    for name, value in (
        ("--rpud-artefacts", options.out and Path(options.out).absolute()),
        ("--junitxml", options.junit),
        ("-k", options.only),
    ):
        words += [f"{name}={value}"] if value else []
    listener = Listener()
    code = pytest.main(words, [listener])
    outcomes = [each for found in listener.campaigns for each in found.outcomes.values()]
    if code == pytest.ExitCode.INTERRUPTED:
        return ExitCode.INTERRUPTED
    if code in (pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED):
        return ExitCode.USAGE
    met = _exit_code(outcomes)
    return ExitCode.FAILED if met == ExitCode.DONE and code != pytest.ExitCode.OK else met


def _test_bag(options: _Test, expect: str) -> int:
    from rpud_sim.verdicts import ExpectationError, Record, evaluate, read_expectations
    from rpud_sim.verdicts.record import check_bag
    from rpud_sim.verdicts.verdict import junit_xml

    expectations = read_expectations(expect)
    topics = sorted({topic for each in expectations for topic in each.topics})
    check_bag(options.subject, expectations, options.namespace, expect)
    with progress_bar(" messages", scaled=True) as bar:
        record = Record.from_bag(options.subject, topics, options.namespace, bar.update)
    with failing(ExpectationError):  # they fit the types: a message holds an impossible value
        verdicts = [evaluate(each, record) for each in expectations]
    for topic in topics:
        if lost := record.missing(topic).total:
            complain("rpud test", f"{lost} messages of {topic} are lost")
    if options.junit:
        target = Path(options.junit)
        # A device or a pipe has no name to replace.
        direct = target.is_symlink() or (target.exists() and not target.is_file())
        with nullcontext(target) if direct else whole_file(target) as file:
            file.write_text(junit_xml(verdicts, options.subject), encoding="utf-8")
    print_json(_content(verdicts, record)) if options.json else print(_account(verdicts, record))
    return _exit_code(each.outcome for each in verdicts)


def _exit_code(outcomes: Iterable[str]) -> ExitCode:
    found = set(outcomes)
    if "failed" in found:
        return ExitCode.INCOMPLETE
    return ExitCode.DONE if found == {"passed"} else ExitCode.FAILED


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
