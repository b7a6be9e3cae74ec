"""`rpud verify`: prove that a bag is what the simulation gives, bit for bit."""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, printable, table

if TYPE_CHECKING:
    from rpud_sim.inspection.verify.verification import Verification

HELP = "run a bag's simulation again and compare every message, bit for bit"
EXAMPLE = "rpud verify bags/first"

_COUNTS = ("equal", "different", "unexpected", "missing", "tail")

DIFFERS = 3
"""Exit code where a message is not what the simulation gives."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud verify`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}. Exit codes: 0 proved, {DIFFERS} a message differs, "
        "1 it cannot be decided or messages are missing at the end, 2 wrong call."
    )
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Verify and print the account; give the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.inspection.verify.recorded_journal import UnverifiableError
    from rpud_sim.inspection.verify.verification import verify

    try:
        with progress_bar(" s") as bar:
            verification = verify(arguments.bag, bar.update)
    except (BagError, UnverifiableError) as error:
        complain("rpud verify", error)
        return 1
    for warning in verification.warnings:
        complain("rpud verify", warning)
    print(json.dumps(_content(verification)) if arguments.json else _account(verification))
    if verification.proved:
        return 0
    # What another version gives is no proof to the contrary.
    differs = verification.first_difference and not verification.other_versions
    return DIFFERS if differs else 1


def _content(verification: Verification) -> dict[str, Any]:
    difference = verification.first_difference
    return {
        "proved": verification.proved,
        "simulated": verification.simulated,
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
    rows = [head] + [
        (
            name,
            *(str(getattr(counts, count)) for count in _COUNTS),
            "unknown" if verification.lost[name] is None else str(verification.lost[name]),
        )
        for name, counts in sorted(verification.topics.items())
    ]
    lines = [*table(rows, left=1), ""]
    difference = verification.first_difference
    if difference is not None:
        at = f"{printable(difference.topic)} at {difference.stamp / 1e9:.9f} s"
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
    lines.append(f"{_verdict(verification)}, {verification.simulated / 1e9:.3f} s simulated again")
    return "\n".join(lines)


def _verdict(verification: Verification) -> str:
    equal = sum(counts.equal for counts in verification.topics.values())
    if verification.proved:
        return f"proved: {equal} messages are equal bit for bit"
    if verification.first_difference and verification.other_versions:
        return "not proved: it differs, and other versions made it"
    if verification.first_difference:
        return "not proved: it differs"
    if verification.undecided:
        return f"not decided: {verification.undecided}"
    return (
        f"not proved: {equal} messages are equal bit for bit, and {verification.tail} are missing"
    )
