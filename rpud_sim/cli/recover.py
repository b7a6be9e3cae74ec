"""`rpud recover`: make a whole bag of one that was cut off or damaged."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, printable, table

if TYPE_CHECKING:
    from rpud_sim.bag import Recovery

HELP = "make a whole bag of one that was cut off or damaged"
EXAMPLE = "rpud recover bags/torn --out bags/whole"

LOST = 3
"""Exit code where the new bag is whole, but not all that the old one held or should hold."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud recover`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}. Exit codes: 0 nothing is lost, "
        f"{LOST} recovered, and something is lost, 1 failed, 2 wrong call."
    )
    parser.add_argument(
        "torn", metavar="TORN", help="a bag's folder or one MCAP file; it is not changed"
    )
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="the bag's new folder; nothing is overwritten"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Recover and print the account; give the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.bag.recovery import files_to_recover, recover

    try:
        size = sum(file.stat().st_size for file in files_to_recover(arguments.torn))
        with progress_bar("B", size, scaled=True) as bar:
            recovery = recover(arguments.torn, arguments.out, bar.update)
    except BagError as error:
        complain("rpud recover", error)
        return 1
    if arguments.json:
        print(json.dumps(recovery.to_mapping(), indent=2))
    else:
        print(_account(recovery))
    return 0 if recovery.complete else LOST


def _account(recovery: Recovery) -> str:
    lines = [f"recovered {recovery.message_count} messages to {printable(recovery.path)}", ""]
    head = ("topic", "type", "recovered", "lost", "gaps")
    rows = [head] + [
        (
            topic.name,
            topic.type,
            str(topic.recovered),
            str(topic.lost),
            "-" if topic.gaps is None else str(topic.gaps),
        )
        for _, topic in sorted(recovery.topics.items())
    ]
    lines += table(rows, left=2)
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
        bound = "" if recovery.max_loss is None else f", at most {recovery.max_loss:g} s"
        lines.append(f"not closed: what its recorder had yet to write is missing{bound}")
    if recovery.complete:
        lines.append("nothing is lost")
    return "\n".join(lines)
