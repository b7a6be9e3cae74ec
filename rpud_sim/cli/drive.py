"""``rpud drive``: command the voltage on the piezoelectric stack."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill, number
from rpud_sim.cli.program import ExitCode

HELP = "drive the actuator of a running drill, or switch it off"
EXAMPLE = "rpud drive --voltage 80"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--off", action="store_true", help="do not drive the actuator")
    parser.add_argument(
        "--voltage", type=number, metavar="V", help="amplitude in volts (default: the present one)"
    )
    parser.add_argument(
        "--frequency", type=number, metavar="HZ", help="in hertz (default: the present one)"
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        drill.drive(not arguments.off, arguments.voltage, arguments.frequency)
        status = drill.status
    state = "on" if status.drive_enabled else "off"
    print(f"drive: {state}, {status.drive_voltage:g} V, {status.drive_frequency:g} Hz")
    return ExitCode.DONE
