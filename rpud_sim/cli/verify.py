"""``rpud verify``: proof that a bag is what the simulation gives, bit for bit."""

from __future__ import annotations

import argparse
import dataclasses
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import add_bag_argument, add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import complain, printable
from rpud_sim.foundation.time import SECOND

if TYPE_CHECKING:
    from rpud_sim.inspection.verify.verification import Verification

HELP = "run a bag's simulation again and compare every message, bit for bit"
DETAILS = (
    "Exit codes: 0 proved, 3 a message differs or, with --strict, is missing, 1 it cannot be "
    "decided or messages are missing at the end, 2 wrong call."
)
EXAMPLE = "rpud verify bags/first"

_COUNTS = ("equal", "different", "unexpected", "missing", "tail", "before")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit code 3 also if messages are missing between recorded ones",
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.verify.verification import verify

    with failing(BagError, InspectionError), progress_bar(" s") as bar:
        verification = verify(arguments.bag, bar.update)
    for warning in verification.warnings:
        complain("rpud verify", warning)
    print_json(_content(verification)) if arguments.json else print(_account(verification))
    if verification.proved:
        lacking = arguments.strict and verification.missing
        return ExitCode.INCOMPLETE if lacking else ExitCode.DONE
    return ExitCode.INCOMPLETE if verification.first_difference else ExitCode.FAILED


def _content(verification: Verification) -> dict[str, Any]:
    difference = verification.first_difference
    return {
        "proved": verification.proved,
        "simulated": verification.simulated,
        "begins": verification.begins,
        "topics": {
            name: {**dataclasses.asdict(counts), "lost": verification.lost[name]}
            for name, counts in sorted(verification.topics.items())
        },
        "first_difference": dataclasses.asdict(difference) if difference else None,
        "undecided": verification.undecided,
        "warnings": list(verification.warnings),
    }


def _account(verification: Verification) -> str:
    head = ("topic", *_COUNTS, "lost")
    rows = [
        (
            name,
            *(getattr(counts, count) for count in _COUNTS),
            "unknown" if verification.lost[name] is None else verification.lost[name],
        )
        for name, counts in sorted(verification.topics.items())
    ]
    lines = [*table(head, rows, left=1), ""]
    difference = verification.first_difference
    if difference is not None:
        at = f"{printable(difference.topic)} at {difference.stamp / SECOND:.9f} s"
        if difference.computed is None:
            lines.append(f"first difference: {at} is a message that the simulation does not give")
        else:
            lines.append(
                f"first difference: {at}: {difference.field or 'the message'} "
                f"is {printable(difference.recorded)}, computed {printable(difference.computed)}"
            )
    lines.extend(
        f"{name}: {counts.tail} messages are missing at the end, while the drill went on"
        for name, counts in sorted(verification.topics.items())
        if counts.tail
    )
    lines.append(
        f"{_verdict(verification)}, {verification.simulated / SECOND:.3f} s simulated again"
    )
    return "\n".join(lines)


def _verdict(verification: Verification) -> str:
    equal = sum(counts.equal for counts in verification.topics.values())
    if verification.proved:
        begins = verification.begins
        since = (
            "" if begins is None else f" from {begins / SECOND:.9f} s on, where its journal begins"
        )
        lacking = f", and {verification.missing} are missing" if verification.missing else ""
        return f"proved{since}: {equal} messages are equal bit for bit{lacking}"
    if verification.first_difference:
        return "not proved: it differs"
    if verification.undecided:
        return f"not decided: {verification.undecided}"
    return (
        f"not proved: {equal} messages are equal bit for bit, and {verification.tail} are missing"
    )
