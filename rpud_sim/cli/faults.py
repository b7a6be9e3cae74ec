"""``rpud faults``: list the faults of a running drill."""

from __future__ import annotations

import argparse
from typing import Any

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.options import add_json_argument
from rpud_sim.cli.program import ExitCode
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import printable

HELP = "list the active faults of a running drill, and what can be injected"
EXAMPLE = "rpud faults --json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_json_argument(parser)
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        answer = drill.list_faults()
    content: dict[str, Any] = {
        "active": [
            {
                "number": fault.number,
                "kind": fault.kind,
                "channel": fault.channel,
                # NaN, for none, is not JSON.
                "magnitude": fault.magnitude if fault.magnitude == fault.magnitude else None,
                "onset": fault.onset.sec + fault.onset.nanosec / 1e9,
            }
            for fault in answer.faults
        ],
        "kinds": list(answer.kinds),
        "channels": list(answer.channels),
    }
    print_json(content) if arguments.json else print(_text(content))
    return ExitCode.DONE


def _text(content: dict[str, Any]) -> str:
    rows = [
        (
            fault["kind"],
            fault["channel"] or "-",
            fault["number"],
            "-" if fault["magnitude"] is None else f"{fault['magnitude']:g}",
            f"{fault['onset']:.3f}",
        )
        for fault in content["active"]
    ]
    head = ("active fault", "channel", "number", "magnitude", "onset [s]")
    return "\n".join(
        [
            *(table(head, rows, left=2) if rows else ["no fault is active"]),
            printable(f"possible kinds: {', '.join(content['kinds'])}"),
            printable(f"channels of signal faults: {', '.join(content['channels'])}"),
        ]
    )
