"""``rpud test``: verdicts on the expectations of a file, over a bag or in a campaign."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import command
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.atomic_folder import atomic_file, check_folder
from rpud_sim.foundation.options import option, positional
from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.foundation.terminal import cell, print_error, printable, table

if TYPE_CHECKING:
    from rpud_sim.testing.campaign_runs import CampaignResults
    from rpud_sim.verdicts import Verdict

SUFFIXES = (".yaml", ".yml")
"""Suffixes of campaign files: any other file or folder is a bag."""

# The package was imported before pytest could rewrite it; its tests do not need that.
_QUIET = ("-W", "ignore::pytest.PytestAssertRewriteWarning")


@command(
    "test",
    "bags/first --expect config/expectations.yaml",
    "evaluate expectations on a bag, or run a campaign of tests",
    "Each expectation is passed, failed or undecided. The last run in a bag is judged. "
    "A campaign runs scenarios, parameters and seeds against a system under test, by pytest, "
    "which gets all further options, such as -n 4 or --lf. "
    "Exit codes: 0 all passed, 1 one is undecided, or a drill failed, 2 usage error, 3 one failed.",
    subject=positional("BAG|CAMPAIGN", "a bag, or a campaign file that ends in .yaml"),
    expect=option(None, "expectations, as in docs/reference", metavar="FILE"),
    namespace=option(None, "of the drill, if the bag has several", metavar="NAME"),
    junit=option(None, "write a JUnit XML file as well", metavar="FILE"),
    json=option(False, "print one JSON object"),
    out=option(None, "folder (default: rpud-artefacts)", metavar="DIR", group="campaigns"),
    only=option(None, "only these runs: -k of pytest", metavar="EXPRESSION", group="campaigns"),
    further=field(default=()),  # words for pytest
)
def _run(options: Any) -> int:
    if Path(options.subject).suffix in SUFFIXES and not Path(options.subject).is_dir():
        return _test_campaign(options)
    if options.further:
        words = printable(" ".join(options.further))
        raise ExpectedError(
            f"unrecognized arguments: {words}; see rpud test --help", ExitCode.USAGE
        )
    if options.expect is None:
        raise ParameterError("a bag needs --expect FILE; see rpud test --help")
    return _test_bag(options, options.expect)


def _test_campaign(options: Any) -> int:
    for name in ("expect", "namespace", "json"):
        if getattr(options, name):
            raise ParameterError(f"--{name} is for bags")
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


def _test_bag(options: Any, expect: str) -> int:
    from rpud_sim.verdicts import Record, evaluate, read_expectations
    from rpud_sim.verdicts.verdict import OUTCOMES, junit_xml

    if options.junit:
        check_folder(Path(options.junit))  # before the work
    expectations = read_expectations(expect)
    topics = sorted({topic for each in expectations for topic in each.topics})
    with progress_bar(" messages", scaled=True) as bar:
        record = Record.from_bag(
            options.subject, topics, options.namespace, bar.update, expectations
        )
    try:
        verdicts = [evaluate(each, record) for each in expectations]
    except ParameterError as error:  # they fit the types: a message holds an impossible value
        raise ExpectedError(error) from error
    for topic in topics:
        if lost := record.missing(topic).total:
            print_error("rpud test", f"{lost} messages of {topic} are lost")
    if options.junit:
        target = Path(options.junit)
        # A device or a pipe has no name to replace.
        direct = target.is_symlink() or (target.exists() and not target.is_file())
        with nullcontext(target) if direct else atomic_file(target) as file:
            file.write_text(junit_xml(verdicts, options.subject), encoding="utf-8")
    counts = {name: sum(each.outcome == name for each in verdicts) for name in OUTCOMES}
    content = {
        "passed": all(each.passed for each in verdicts),
        "counts": counts,
        "runs": record.runs,
        "verdicts": [each.to_dict() for each in verdicts],
    }
    print_result(options, content, lambda: _lines(verdicts, counts, record.runs))
    return _exit_code(each.outcome for each in verdicts)


def _exit_code(outcomes: Iterable[str]) -> ExitCode:
    found = set(outcomes)
    if "failed" in found:
        return ExitCode.INCOMPLETE
    return ExitCode.DONE if found == {"passed"} else ExitCode.FAILED


def _lines(verdicts: list[Verdict], counts: dict[str, int], runs: int) -> Iterator[str]:
    head = ("requirement", "name", "verdict", "margin", "at [s]", "reaction [s]")
    rows = [
        (
            *(each.requirement or "-", each.name, each.outcome),
            f"{cell(each.margin, '.4g')} {each.unit}".rstrip(),
            *(cell(each.at, ".3f"), cell(each.reaction_time, ".3f")),
        )
        for each in verdicts
    ]
    yield from table(head, rows, left=3)
    yield ""
    for each in verdicts:
        if each.outcome == "undecided":
            yield f"undecided: {printable(each.name)}: {printable(each.text)}"
    said = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    yield said + (f"; of {runs} runs in the bag, the last" if runs > 1 else "")
