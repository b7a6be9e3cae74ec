"""`rpud verify`: prove that a bag is what the simulation gives, bit for bit."""

from __future__ import annotations

import argparse
import dataclasses
import json
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.progress import progress_bar
from rpud_sim.terminal import complain, printable, table

if TYPE_CHECKING:
    from rpud_sim.analysis.proof.verification import Verification

HELP = "run a bag's simulation again and compare every message, bit for bit"
EXAMPLE = "rpud verify bags/first"

DIFFERS = 3
"""Exit code where a message is not what the simulation gives."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud verify`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}. Exit codes: 0 proved, {DIFFERS} a message differs, "
        "1 cannot be verified, 2 wrong call."
    )
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Verify and print the account; give the exit code."""
    from rpud_sim.analysis.proof.entries import UnverifiableError
    from rpud_sim.analysis.proof.verification import verify
    from rpud_sim.bag import BagError

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
    return 1 if verification.other_versions else DIFFERS


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
        "warnings": list(verification.warnings),
    }


def _account(verification: Verification) -> str:
    head = ("topic", "equal", "different", "unexpected", "missing", "lost")
    rows = [head] + [
        (
            name,
            *(str(n) for n in (counts.equal, counts.different, counts.unexpected, counts.missing)),
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
    simulated = f"{verification.simulated / 1e9:.3f} s simulated again"
    if verification.proved:
        equal = sum(counts.equal for counts in verification.topics.values())
        lines.append(f"proved: {equal} messages are equal bit for bit, {simulated}")
    elif verification.other_versions:
        lines.append(f"not proved: it differs, and other versions made it, {simulated}")
    else:
        lines.append(f"not proved: it differs, {simulated}")
    return "\n".join(lines)
