"""Campaigns of ``rpud test``: their arguments, their run, and their account."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rpud_sim.cli.options import Number, pattern, worker_count
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.testing.campaign.results import Cell, Results

SUFFIXES = (".yaml", ".yml")  # suffixes of campaign files: any other file or folder is a bag

_WORKERS = Quantity("", "runs at the same time", 1, 100, whole=True)
_REPEAT = Quantity("", "repetitions", 1, 100_000, whole=True)
_MOST_LINES = 20  # of failures: the page has all


def add_campaign_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("campaigns")
    group.add_argument(
        "--out",
        metavar="DIR",
        help="folder for results and bags; runs of an earlier call are kept if nothing has changed",
    )
    group.add_argument(
        "--workers",
        action=Number,
        quantity=_WORKERS,
        metavar="N",
        help="runs at the same time (default: one for each core of this machine)",
    )
    group.add_argument("--again", action="store_true", help="fly runs that have ended once more")
    group.add_argument(
        "--only", type=pattern, metavar="REGEX", help="fly only runs in whose names this is found"
    )
    group.add_argument(
        "--repeat",
        action=Number,
        quantity=_REPEAT,
        metavar="N",
        default=1,
        help="fly each run N times; fail if two results of one run differ",
    )


def test_campaign(arguments: argparse.Namespace) -> int:
    """Fly a campaign and print its account; return the exit code."""
    for name in ("expect", "namespace"):
        if getattr(arguments, name) is not None:
            raise CommandError(f"--{name} is for bags; a campaign file has its own", ExitCode.USAGE)
    if arguments.out is None:
        raise CommandError("a campaign needs --out DIR; see rpud test --help", ExitCode.USAGE)
    from rpud_sim.studies.processes import WorkerError
    from rpud_sim.testing.campaign.campaign import JUNIT, PAGE, RESULTS, run_campaign
    from rpud_sim.testing.campaign.campaign_file import read_campaign
    from rpud_sim.testing.campaign.specification import CampaignError

    started = time.perf_counter()
    out = Path(arguments.out)
    with failing(CampaignError, code=ExitCode.USAGE), failing(WorkerError, OSError):
        campaign = read_campaign(arguments.subject)
        if arguments.only is not None:
            campaign = campaign.only(arguments.only)
        campaign = campaign.repeated(arguments.repeat)
        with progress_bar(" runs", len(campaign.runs)) as bar:
            results, flown = run_campaign(
                campaign,
                out,
                worker_count(arguments),
                arguments.again,
                bar.update,
            )
        if arguments.junit:
            text = (out / JUNIT).read_text(encoding="utf-8")
            Path(arguments.junit).write_text(text, encoding="utf-8")
    for each in results.runs:
        for text in each.outcome.broken:
            reason = text.partition("\n")[0]
            complain("rpud test", f"{each.run.name}: flown again: {reason}")
    for name, digests in results.digests.items():
        if len(digests) > 1:
            complain("rpud test", f"{name}: its repetitions have {len(digests)} different results")
    if arguments.json:
        print_json({"out": str(out), "run": flown, **results.to_dict()})
    else:
        print(_account(results))
        print(
            f"{len(results.runs)} runs: {flown} flown, {len(results.runs) - flown} kept, "
            f"in {time.perf_counter() - started:.1f} s"
        )
        if arguments.repeat > 1 and results.repeatable:
            print(f"each run gave one result in {arguments.repeat} repetitions")
        print(f"digest {results.digest[:16]}")
        for name in (PAGE, JUNIT, RESULTS):
            print(printable(out / name))
    return ExitCode.DONE if results.passed and results.repeatable else ExitCode.FAILED


def _account(results: Results) -> str:
    names = [scenario.name for scenario in results.campaign.scenarios]
    rows = [
        (each.identifier, each.outcome, *(_cell(each.cells.get(name)) for name in names))
        for each in results.requirements
    ]
    lines = table(("requirement", "verdict", *names), rows, left=2 + len(names))
    failures = [
        f"{verdict.outcome}: {verdict.requirement or verdict.name}: {flown.run.name}: "
        f"{verdict.text}"
        for flown in results.runs
        for verdict in flown.outcome.verdicts
        if verdict.outcome == "failed"
    ]
    counts = ", ".join(f"{count} {outcome}" for outcome, count in results.counts.items())
    shown = [printable(line) for line in failures[:_MOST_LINES]]
    if len(failures) > _MOST_LINES:
        shown.append(f"and {len(failures) - _MOST_LINES} further failures")
    return "\n".join([*lines, "", *shown, f"requirements: {counts}"])


def _cell(cell: Cell | None) -> str:
    if cell is None:
        return "-"
    margin = "" if cell.margin is None else f" {cell.margin:.3g} {cell.unit}".rstrip()
    reaction = "" if cell.reaction_time is None else f" in {cell.reaction_time:.2f} s"
    return f"{cell.outcome}{margin}{reaction}"
