"""``rpud fork``: go on from any instant of a recorded run, the same way or another."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.live_line import logging_above
from rpud_sim.cli.options import ASSIGNMENT, BAG, command, run_number_option
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.options import POSITIVE_SECONDS, SECONDS, option, required
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.simulation.changes import PlannedChanges


@command(
    "fork",
    "bags/first --at 1.5 --inject hard_rock,magnitude=5 --out bags/harder",
    "go on from any instant of a recorded run, with other commands, parameters or faults",
    "Without a change the new bag equals the rest of the recorded one, bit for bit. A recorded "
    "change after the instant is repeated, unless the fork has its own; a live drill repeats none.",
    BAG,
    at=required("instant of the fork: simulation time since the run began", quantity=SECONDS),
    duration=option(
        None, "go on so long (default: to the recorded end, or SIGINT)", POSITIVE_SECONDS
    ),
    assignments=option((), "another value of a parameter; can be repeated", **ASSIGNMENT),
    inject=option(
        (),
        "inject a fault; keys are channel, magnitude, duration and onset, the seconds from the "
        "instant to the fault; can be repeated",
        action="append",
        metavar="KIND[,KEY=VALUE...]",
    ),
    commands=option(None, "faults, and commands in place of the recorded ones", metavar="FILE"),
    out=option(None, "write a new bag; with --live record it", metavar="DIR"),
    live=option(False, "go on as a drill node, on ROS topics"),
    run=run_number_option(),
    topic=option(None, "topic of the journal, if there are several", metavar="NAME"),
    namespace=option(None, "with --live: namespace of the node (default: the recorded one)"),
    quiet=option(False, "with --live: no live line"),
)
def _run(options: Any) -> int:
    if options.live and options.json:
        raise ParameterError("--json goes with a bag, not with --live")
    if not (options.live or options.out):
        raise ParameterError("where to? give --out DIR, or --live")
    if not options.live and (options.namespace or options.quiet):
        raise ParameterError("--namespace and --quiet go with --live")
    changes = _changes(options)
    return _live(options, changes) if options.live else _to_bag(options, changes)


def _changes(options: Any) -> PlannedChanges:
    from rpud_sim.recorded.fork import LIVE
    from rpud_sim.simulation.changes import PlannedChanges, parameter_changes
    from rpud_sim.simulation.configuration import parse_assignment
    from rpud_sim.simulation.scenario_file import parse_injections, read_commands

    values = dict(parse_assignment(text) for text in options.assignments)
    changes = parameter_changes(values, LIVE if options.live else ())
    changes += parse_injections(options.inject)
    return changes + (read_commands(options.commands) if options.commands else PlannedChanges())


def _to_bag(options: Any, changes: PlannedChanges) -> int:
    from rpud_sim.recorded.fork import write_fork

    with progress_bar(" s") as bar:
        forked = write_fork(
            options.bag,
            options.out,
            options.at,
            options.duration,
            changes,
            run=options.run,
            topic=options.topic,
            report=bar.update,
        )
    for warning in forked.warnings:
        complain("rpud fork", warning)
    how = "with changes" if forked.changed else "without a change"
    said = (
        f"forked {printable(forked.source)} at {forked.at:.9g} s {how}: {forked.duration:.9g} s "
        f"and {forked.messages} messages in {printable(forked.path)}"
    )
    print_result(options, dataclasses.asdict(forked), lambda: [said])
    return ExitCode.DONE


def _live(options: Any, changes: PlannedChanges) -> int:
    from rpud_sim.cli.run import drill
    from rpud_sim.recorded.fork import Fork
    from rpud_sim.ros.drill.drill_node import open_drill
    from rpud_sim.ros.process import StopRequest

    fork = Fork(options.bag, options.at, changes, options.run, options.topic)
    start = fork.start()
    namespace = options.namespace or fork.recorded.prefix.rstrip("/") or "/"
    with (
        StopRequest() as stop,
        logging_above(
            not options.quiet,
            open_drill(start.settings.values(), namespace, options.duration, start=start),
        ) as node,
    ):
        return drill(node, stop, "rpud fork", options.out, live=not options.quiet)
