"""``rpud recover``: make a whole bag of one that was cut off or damaged."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rpud_sim.cli.options import add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import printable

if TYPE_CHECKING:
    from rpud_sim.bag import Recovery

HELP = "make a whole bag of one that was cut off or damaged"
DETAILS = (
    "Exit codes: 0 nothing is lost, 3 recovered, and something is lost, 1 failed, 2 wrong call."
)
EXAMPLE = "rpud recover bags/torn --out bags/whole"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "torn", metavar="TORN", help="a bag's folder or one MCAP file; it is not changed"
    )
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="the bag's new folder; nothing is overwritten"
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.bag.recovery import files_to_recover, recover

    with failing(BagError):
        size = sum(file.stat().st_size for file in files_to_recover(arguments.torn))
        with progress_bar("B", size, scaled=True) as bar:
            recovery = recover(arguments.torn, arguments.out, bar.update)
    print_json(recovery.to_mapping()) if arguments.json else print(_account(recovery))
    return ExitCode.DONE if recovery.complete else ExitCode.INCOMPLETE


def _account(recovery: Recovery) -> str:
    lines = [f"recovered {recovery.message_count} messages to {printable(recovery.path)}", ""]
    head = ("topic", "type", "recovered", "lost", "gaps")
    rows = [
        (
            topic.name,
            topic.type,
            topic.recovered,
            topic.lost,
            "-" if topic.gaps is None else topic.gaps,
        )
        for _, topic in sorted(recovery.topics.items())
    ]
    lines += table(head, rows, left=2)
    lines.append("")
    for topic in recovery.topics.values():
        if topic.unchecked:
            lines.append(f"{topic.unchecked} messages on {printable(topic.name)} have no checksum")
        losses = topic.recording_losses
        if losses is not None and losses.total != 0:
            lost = "unknown" if losses.total is None else losses.total
            lines.append(f"lost before they were written on {printable(topic.name)}: {lost}")
    lines += map(printable, recovery.damages)
    if recovery.damage_count > len(recovery.damages):
        lines.append(f"... {recovery.damage_count} damaged places in all")
    if recovery.size_lost:
        lines.append(f"{recovery.size_lost} bytes could not be read")
    if not recovery.closed:
        bound = (
            ""
            if recovery.max_loss is None
            else (f", at most {recovery.max_loss:g} s if processor and disk kept up")
        )
        lines.append(f"not closed: what its recorder had yet to write is missing{bound}")
    if recovery.complete:
        lines.append("nothing is lost")
    return "\n".join(lines)
