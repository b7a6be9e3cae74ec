"""``rpud simulate`` and ``rpud fork``: runs as fast as possible, from the start or an instant."""

from __future__ import annotations

import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.live_line import logging_above
from rpud_sim.cli.options import (
    ASSIGNMENT,
    BAG,
    JSON,
    PARAMETERS,
    command,
    parameter_values,
    run_number_option,
)
from rpud_sim.cli.program import ExitCode, print_result, progress_bar
from rpud_sim.foundation.options import POSITIVE_SECONDS, SECONDS, SEED, option, required
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import cell, print_error, printable

if TYPE_CHECKING:
    from rpud_sim.simulation.changes import PlannedChanges
    from rpud_sim.simulation.plan import Plan

_DURATION = Quantity("s", "simulated time", 1e-9, 1e6)  # time is whole nanoseconds
_REPEAT = Quantity("", "number of runs", 1, 1e6, whole=True)


@command(
    "simulate",
    "--regime drilling --duration 20 --set weight_on_bit=20 --json",
    "run the drill offline, faster than real time, and print its metrics",
    "",
    {**JSON, **PARAMETERS},
    duration=option(10.0, "simulated time", _DURATION),
    repeat=option(1, "runs over initial vibration phases, for standard errors", _REPEAT),
    seed=option(None, "seed of initial phases, scenario and noise (default: the file's)", SEED),
    commands=option(None, "commands and faults at their times, as in rpud fork", metavar="FILE"),
    bag=option(None, "write the run as a bag with the topics of the node", metavar="DIR", new=True),
)
def _run(options: Any) -> int:
    if options.bag and options.repeat > 1:
        raise ParameterError("--bag goes with a single run, not with --repeat")
    _refuse_assignments_to_the_node(options.assignments)
    metrics = _simulate(options)
    print_result(options, metrics, lambda: _lines(metrics))
    return ExitCode.DONE


def _refuse_assignments_to_the_node(assignments: Sequence[str]) -> None:
    """Reject parameters without effect here; a file may hold them, for the node reads it too."""
    from rpud_sim.simulation.configuration import NODE_NAMES, parse_assignment

    for text in assignments:
        name, _ = parse_assignment(text)
        if name in NODE_NAMES and name not in ("scenario", "seed"):
            raise ParameterError(f"{name} is a parameter of the drill node alone: see rpud run")


def _simulate(options: Any) -> dict[str, Any]:
    from rpud_sim.drilling.rock import NO_DEEPER
    from rpud_sim.simulation.configuration import to_settings
    from rpud_sim.simulation.ensemble import compile_kernels, phases_of, run_ensemble
    from rpud_sim.simulation.plan import Beginning, Plan
    from rpud_sim.simulation.scenario_file import read_commands
    from rpud_sim.simulation.unused_parameters import doubts

    values = parameter_values(options)
    beginning = Beginning.drawn(to_settings(values), options.seed)
    for line in doubts(values, beginning.settings):
        _show(line)
    planned = read_commands(options.commands).changes if options.commands else ()
    plan = Plan(beginning, planned)
    settings = beginning.settings
    configuration = settings.configuration
    compile_kernels(configuration, _show, messages=bool(options.bag))
    with progress_bar(" s", options.duration * options.repeat) as bar:
        if options.bag:
            found = _write_bag(options, plan, bar.update)
        else:
            threads = len(os.sched_getaffinity(0))
            plans = phases_of(plan, options.repeat)
            ensemble = run_ensemble(plans, options.duration, bar.update, threads)
            found = {**ensemble.mean(), "real_time_factor": ensemble.real_time_factor}
            if options.repeat > 1:
                found["standard_error"] = ensemble.standard_error()
    if (found.get("depth") or 0.0) >= configuration.parameters.tool_length:
        _show(NO_DEEPER)
    groups = ("parameters", "actuator", "rock", "rotation", "mount", "strata", "bit")
    return {
        **found,
        "regime": configuration.parameters.regime,
        "repeat": options.repeat,
        "seed": settings.seed_or_none,
        **{group: dataclasses.asdict(getattr(configuration, group)) for group in groups},
        "scenario": settings.scenario or None,
    }


def _write_bag(options: Any, plan: Plan, report: Callable[[float], object]) -> dict[str, Any]:
    """Write the bag, and return the metrics of the same run."""
    from rpud_sim.foundation.user_files import read_file
    from rpud_sim.recorded.offline_bag import write_offline_bag
    from rpud_sim.simulation.metrics import Metrics

    metrics, file = Metrics(), plan.beginning.settings.scenario
    text = read_file(file).decode() if file else ""
    started = time.perf_counter()
    write_offline_bag(
        options.bag, plan, options.duration, text, report=report, on_block=metrics.add
    )
    factor = metrics.duration / (time.perf_counter() - started)
    return {**metrics.to_dict(), "real_time_factor": factor}


def _lines(metrics: dict[str, Any]) -> Iterator[str]:
    from rpud_sim.foundation.shown_quantities import METRIC_UNITS

    errors = metrics.get("standard_error", {})
    for name, unit in {"duration": "s", **METRIC_UNITS, "real_time_factor": ""}.items():
        if name in metrics:
            error = cell(errors.get(name), ".2g", "")
            text = cell(metrics[name], ".6g") + (error and f" +- {error}")
            yield f"{name:24} {text} {unit}".rstrip()


def _show(line: str) -> None:
    print_error("rpud simulate", line)


@command(
    "fork",
    "bags/first --at 1.5 --inject hard_rock,magnitude=5 --out bags/harder",
    "continue a recorded run from any time, with other commands, parameters or faults",
    "Without a change the new bag equals the rest of the recorded one, bit for bit. Later recorded "
    "changes are repeated, unless the fork has its own; a live drill repeats none.",
    BAG,
    at=required(
        "start of the fork, in simulation time since the beginning of the run", quantity=SECONDS
    ),
    duration=option(
        None, "duration of the fork (default: to the recorded end, or SIGINT)", POSITIVE_SECONDS
    ),
    assignments=option((), "another value of a parameter; can be repeated", **ASSIGNMENT),
    inject=option(
        (),
        "inject a fault; keys are channel, magnitude, duration and onset, in seconds from the "
        "start of the fork; can be repeated",
        action="append",
        metavar="KIND[,KEY=VALUE...]",
    ),
    commands=option(None, "faults, and commands instead of the recorded ones", metavar="FILE"),
    out=option(None, "write a new bag; with --live record it", metavar="DIR", new=True),
    live=option(False, "continue as a drill node, on ROS topics"),
    run=run_number_option(),
    topic=option(None, "topic of the journal, if there are several", metavar="NAME"),
    namespace=option(None, "with --live: namespace of the node (default: the recorded one)"),
    quiet=option(False, "with --live: no live line"),
)
def _fork(options: Any) -> int:
    if options.live and options.json:
        raise ParameterError("--json goes with a bag, not with --live")
    if not (options.live or options.out):
        raise ParameterError("no destination: use --out DIR or --live")
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
        print_error("rpud fork", warning)
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
    plan, settings = fork.live()
    namespace = options.namespace or fork.recorded.prefix.rstrip("/") or "/"
    with (
        StopRequest() as stop,
        logging_above(
            not options.quiet,
            open_drill(settings.values(), namespace, options.duration, plan=plan),
        ) as node,
    ):
        return drill(node, stop, "rpud fork", options.out, live=not options.quiet)
