"""``rpud fork``: go on from any instant of a recorded run, the same way or another."""

from __future__ import annotations

import argparse
import dataclasses
from typing import TYPE_CHECKING

from rpud_sim.cli.live_line import logging_above
from rpud_sim.cli.options import (
    POSITIVE_SECONDS,
    SECONDS,
    Number,
    add_bag_argument,
    add_json_argument,
    add_run_argument,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.inspection.offline_bag import ForkedBag
    from rpud_sim.simulation.changes import Changes

HELP = "go on from any instant of a recorded run, with other commands, parameters or faults"
DETAILS = (
    "Without a change the new bag equals the rest of the recorded one, bit for bit. A recorded "
    "change after the instant is repeated, unless the fork has its own; a live drill repeats none."
)
EXAMPLE = "rpud fork bags/first --at 1.5 --inject hard_rock,magnitude=5 --out bags/harder"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument(
        "--at",
        action=Number,
        quantity=SECONDS,
        required=True,
        metavar="S",
        help="instant of the fork: simulation time since the beginning of the run",
    )
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="go on for that many seconds (default: to the end of the recorded run; live: until "
        "SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="assignments",
        help="another value of a parameter from the instant on; can be repeated",
    )
    parser.add_argument(
        "--inject",
        action="append",
        default=[],
        metavar="KIND[,KEY=VALUE...]",
        help="inject a fault at the instant; keys are channel, magnitude, duration and onset, the "
        "seconds from the instant to the fault; can be repeated",
    )
    parser.add_argument(
        "--commands",
        metavar="FILE",
        help="a scenario with faults, and with commands that replace the recorded ones; its times "
        "count from the instant",
    )
    parser.add_argument("--out", metavar="DIR", help="write a new bag; with --live record it")
    parser.add_argument("--live", action="store_true", help="go on as a drill node, on ROS topics")
    add_run_argument(parser)
    parser.add_argument(
        "--topic", metavar="NAME", help="topic of the journal, if there are several"
    )
    parser.add_argument(
        "--namespace", help="with --live: namespace of the node (default: the recorded one)"
    )
    parser.add_argument("--quiet", action="store_true", help="with --live: no live line")
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    if not (arguments.out or arguments.live):
        raise ParameterError("where to? give --out DIR, or --live")
    if arguments.live and arguments.json:
        raise ParameterError("--json goes with a bag, not with --live")
    if not arguments.live and (arguments.namespace or arguments.quiet):
        raise ParameterError("--namespace and --quiet go with --live")
    changes = _changes(arguments)
    return _live(arguments, changes) if arguments.live else _to_bag(arguments, changes)


def _changes(arguments: argparse.Namespace) -> Changes:
    from rpud_sim.inspection.fork import LIVE
    from rpud_sim.simulation.changes import (
        Changes,
        parameter_changes,
        parse_injections,
        read_commands,
    )
    from rpud_sim.simulation.parameter_files import parse_assignment

    values = dict(parse_assignment(text) for text in arguments.assignments)
    changes = parameter_changes(values, LIVE if arguments.live else ())
    changes += parse_injections(arguments.inject)
    return changes + (read_commands(arguments.commands) if arguments.commands else Changes())


def _to_bag(arguments: argparse.Namespace, changes: Changes) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.offline_bag import write_fork
    from rpud_sim.simulation import EngineError

    with failing(BagError, InspectionError, EngineError), progress_bar(" s") as bar:
        forked = write_fork(
            arguments.bag,
            arguments.out,
            arguments.at,
            arguments.duration,
            changes,
            run=arguments.number,
            topic=arguments.topic,
            report=bar.update,
        )
    for warning in forked.warnings:
        complain("rpud fork", warning)
    print_json(dataclasses.asdict(forked)) if arguments.json else print(_account(forked))
    return ExitCode.DONE


def _account(forked: ForkedBag) -> str:
    how = "with changes" if forked.changed else "without a change"
    return (
        f"forked {printable(forked.source)} at {forked.at:.9g} s {how}: {forked.duration:.9g} s "
        f"and {forked.messages} messages in {printable(forked.path)}"
    )


def _live(arguments: argparse.Namespace, changes: Changes) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.cli.run import drill
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.fork import live_start, open_fork
    from rpud_sim.ros.drill.session import NamesakeError, open_drill
    from rpud_sim.ros.starting import StartError
    from rpud_sim.ros.stopping import StopRequest
    from rpud_sim.simulation import EngineError

    with failing(BagError, InspectionError, EngineError), progress_bar(" s") as bar:
        fork = open_fork(
            arguments.bag,
            arguments.at,
            changes,
            run=arguments.number,
            topic=arguments.topic,
            stop=True,
            report=bar.update,
        )
        start = live_start(fork, changes)
    namespace = arguments.namespace or fork.recorded.prefix.rstrip("/") or "/"
    with (
        failing(NamesakeError),
        failing(StartError, code=ExitCode.USAGE),
        StopRequest() as stop,
        logging_above(
            not arguments.quiet,
            open_drill(start.settings.values(), namespace, arguments.duration, start=start),
        ) as node,
    ):
        return drill(node, stop, "rpud fork", record=arguments.out, live=not arguments.quiet)
