"""Commands that act on a running drill: press, drive, feed, engage, faults, time, parameters."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rpud_sim.cli.drill_arguments import add_drill_arguments, connected_drill, number
from rpud_sim.cli.options import POSITIVE_SECONDS, Number
from rpud_sim.cli.program import CommandError, ExitCode
from rpud_sim.cli.tables import table
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import printable

_SCOPES = ("all", "time", "state", "faults")
_SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)

_Argument = tuple[str, Mapping[str, Any]]


def _argument(name: str, **options: Any) -> _Argument:
    """Argument of a command, as ``argparse`` takes it."""
    return name, options


@dataclass(frozen=True)
class DrillCommand:
    """Command that acts on a running drill and prints one text."""

    HELP: str  # what it does
    EXAMPLE: str  # call of it
    act: Callable[[argparse.Namespace], str]  # acts on the drill; returns the text
    arguments: tuple[_Argument, ...] = ()  # beside those of every command on a drill
    exclusive: bool = False  # whether exactly one of its arguments has to be given

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        own: argparse._ActionsContainer = parser
        if self.exclusive:
            own = parser.add_mutually_exclusive_group(required=True)
        for name, options in self.arguments:
            own.add_argument(name, **options)
        add_drill_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> ExitCode:
        """Act on the drill and print; return the exit code when the drill has accepted it."""
        print(self.act(arguments))
        return ExitCode.DONE


def _press(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.press(arguments.force)
    return f"weight on bit: {arguments.force:g} N"


def _drive(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.drive(not arguments.off, arguments.voltage, arguments.frequency)
        status = drill.status
    state = "on" if status.drive_enabled else "off"
    return f"drive: {state}, {status.drive_voltage:g} V, {status.drive_frequency:g} Hz"


def _feed(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.feed(arguments.rate, arguments.position)
    if arguments.rate is not None:
        return f"feed: {arguments.rate:g} m/s"
    return f"feed: to {arguments.position:g} m"


def _engage(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.engage(not arguments.off)
        return f"regime: {drill.status.regime}"


def _inject(arguments: argparse.Namespace) -> str:
    if (arguments.kind is None) != arguments.list:
        raise CommandError("needs either KIND or --list", ExitCode.USAGE)
    if arguments.list:
        return _list_faults(arguments)
    with connected_drill(arguments) as drill:
        fault = drill.inject(
            arguments.kind, arguments.channel, arguments.magnitude, arguments.duration
        )
    return f"fault {fault}: {' on '.join(filter(None, (arguments.kind, arguments.channel)))}"


def _list_faults(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        answer = drill.list_faults()
    active = [
        {
            "number": fault.number,
            "kind": fault.kind,
            "channel": fault.channel,
            # NaN, for none, is not JSON.
            "magnitude": fault.magnitude if fault.magnitude == fault.magnitude else None,
            "onset": fault.onset.sec + fault.onset.nanosec / 1e9,
        }
        for fault in answer.faults
    ]
    if arguments.json:
        kinds, channels = list(answer.kinds), list(answer.channels)
        return json.dumps({"active": active, "kinds": kinds, "channels": channels}, indent=2)
    rows = [
        (
            fault["kind"],
            fault["channel"] or "-",
            fault["number"],
            "-" if fault["magnitude"] is None else f"{fault['magnitude']:g}",
            f"{fault['onset']:.3f}",
        )
        for fault in active
    ]
    head = ("active fault", "channel", "number", "magnitude", "onset [s]")
    return "\n".join(
        [
            *(table(head, rows, left=2) if rows else ["no fault is active"]),
            printable(f"possible kinds: {', '.join(answer.kinds)}"),
            printable(f"channels of signal faults: {', '.join(answer.channels)}"),
        ]
    )


def _clear(arguments: argparse.Namespace) -> str:
    if (arguments.fault is None) != arguments.all:
        raise CommandError("needs either FAULT or --all", ExitCode.USAGE)
    which = "all" if arguments.all else arguments.fault
    with connected_drill(arguments) as drill:
        cleared = drill.clear(int(which) if which.isdecimal() else which)
    return f"cleared: {printable(', '.join(map(str, cleared)) or 'no fault was active')}"


def _pause(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.pause()
        return f"state: {drill.status.state}"


def _play(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.play()
        return f"state: {drill.status.state}"


def _step(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        reached = drill.step(arguments.seconds)
    return f"time: {reached:.9f} s"


def _reset(arguments: argparse.Namespace) -> str:
    with connected_drill(arguments) as drill:
        drill.reset(arguments.scope, arguments.seed)
        return f"state: {drill.status.state}, time: {drill.time:.9f} s"


def _set(arguments: argparse.Namespace) -> str:
    from rpud_sim.simulation.parameter_files import parse_assignment

    values = dict(map(parse_assignment, arguments.assignments))
    with connected_drill(arguments) as drill:
        drill.set_parameters(**values)
    return printable(", ".join(f"{name}: {value}" for name, value in values.items()))


DRILL_COMMANDS: Mapping[str, DrillCommand] = {
    "press": DrillCommand(
        "press a running drill onto the rock with a weight on bit",
        "rpud press 30",
        _press,
        (_argument("force", type=number, metavar="FORCE", help="weight on bit in newtons"),),
    ),
    "drive": DrillCommand(
        "drive the actuator of a running drill, or switch it off",
        "rpud drive --voltage 80",
        _drive,
        (
            _argument("--off", action="store_true", help="do not drive the actuator"),
            _argument(
                "--voltage",
                type=number,
                metavar="V",
                help="amplitude in volts (default: the present one)",
            ),
            _argument(
                "--frequency",
                type=number,
                metavar="HZ",
                help="in hertz (default: the present one)",
            ),
        ),
    ),
    "feed": DrillCommand(
        "feed a running drill on an arm toward the rock, or retract it",
        "rpud feed --rate 0.0005",
        _feed,
        (
            _argument(
                "--rate", type=number, metavar="V", help="toward the rock in m/s; 0 holds the mount"
            ),
            _argument(
                "--position", type=number, metavar="X", help="along the drill axis in metres"
            ),
        ),
        exclusive=True,
    ),
    "engage": DrillCommand(
        "put the tool of a running drill into the rock, or take it out",
        "rpud engage --off",
        _engage,
        (_argument("--off", action="store_true", help="take the tool out of the rock"),),
    ),
    "inject": DrillCommand(
        "inject a fault into a running drill, or list its faults",
        "rpud inject free_mass_jammed --for 5",
        _inject,
        (
            _argument(
                "kind",
                nargs="?",
                metavar="KIND",
                help="kind of the fault; `rpud inject --list` lists those that are possible",
            ),
            _argument(
                "--channel",
                default="",
                metavar="C",
                help="topic with the faulty signal, such as reacting_force; only for signal faults",
            ),
            _argument(
                "--magnitude",
                type=number,
                metavar="M",
                help="how much, in the unit of the kind (default: that of the kind)",
            ),
            _argument(
                "--for",
                dest="duration",
                action=Number,
                quantity=POSITIVE_SECONDS,
                metavar="S",
                help="end the fault after that many seconds of simulation time (default: never)",
            ),
            _argument(
                "--list",
                action="store_true",
                help="list the active faults, and the kinds and channels that are possible now",
            ),
            _argument("--json", action="store_true", help="print the list as one JSON object"),
        ),
    ),
    "clear": DrillCommand(
        "end faults of a running drill",
        "rpud clear free_mass_jammed",
        _clear,
        (
            _argument(
                "fault", nargs="?", metavar="FAULT", help="number of a fault, or a kind of faults"
            ),
            _argument("--all", action="store_true", help="end all faults"),
        ),
    ),
    "pause": DrillCommand(
        "let the time of a running drill stand still, so that it can be stepped",
        "rpud pause",
        _pause,
    ),
    "play": DrillCommand("let the time of a paused drill pass", "rpud play", _play),
    "step": DrillCommand(
        "advance a paused drill by some seconds of simulation time",
        "rpud step 0.1",
        _step,
        (_argument("seconds", type=number, metavar="SECONDS", help="of simulation time"),),
    ),
    "reset": DrillCommand(
        "let a running drill begin again",
        "rpud reset --seed 7",
        _reset,
        (
            _argument(
                "--scope",
                choices=_SCOPES,
                default="all",
                help="what begins again (default: %(default)s)",
            ),
            _argument(
                "--seed",
                action=Number,
                quantity=_SEED,
                metavar="N",
                help="of phase, scenario and noise from here on (default: the present one)",
            ),
        ),
    ),
    "set": DrillCommand(
        "set parameters of a running drill",
        "rpud set real_time_factor=0.5",
        _set,
        (
            _argument(
                "assignments",
                nargs="+",
                metavar="NAME=VALUE",
                help="a parameter that may change while the drill runs, in SI units",
            ),
        ),
    ),
}
"""Commands of ``rpud``, by name."""
