"""``rpud simulate`` and ``rpud fork``: runs as fast as possible, from the start or an instant."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
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
from rpud_sim.foundation.options import POSITIVE_SECONDS, SECONDS, option, required
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import cell, complain, printable

if TYPE_CHECKING:
    from rpud_sim.simulation.changes import Change, PlannedChanges
    from rpud_sim.simulation.configuration import Configuration

_DURATION = Quantity("s", "simulated time", 1e-9, 1e6)  # time is whole nanoseconds
_REPEAT = Quantity("", "number of runs", 1, 1e6, whole=True)
_SEED = Quantity("", "seed", 0, 2**63, whole=True)


@command(
    "simulate",
    "--regime drilling --duration 20 --set weight_on_bit=20 --json",
    "run the drill offline, faster than real time, and print its figures",
    "",
    {**JSON, **PARAMETERS},
    duration=option(10.0, "simulated time", _DURATION),
    repeat=option(1, "runs over initial vibration phases, for standard errors", _REPEAT),
    seed=option(None, "seed of phases, and of the scenario instead of its own seed", _SEED),
    commands=option(None, "commands and faults at their times, as of rpud fork", metavar="FILE"),
    bag=option(None, "write the run as a bag with the topics of the node", metavar="DIR"),
)
def _run(options: Any) -> int:
    if options.bag and options.repeat > 1:
        raise ParameterError("--bag goes with a single run, not with --repeat")
    _refuse_assignments_to_the_node(options.assignments)
    figures = _simulate(options)
    print_result(options, figures, lambda: _lines(figures))
    return ExitCode.DONE


def _refuse_assignments_to_the_node(assignments: Sequence[str]) -> None:
    """Refuse parameters without effect here; a file may hold them, for the node reads it too."""
    from rpud_sim.simulation.configuration import NODE_NAMES, parse_assignment

    for text in assignments:
        name, _ = parse_assignment(text)
        if name in NODE_NAMES and name != "scenario":
            raise ParameterError(f"{name} is a parameter of the drill node alone: see rpud run")


def _simulate(options: Any) -> dict[str, Any]:
    from rpud_sim.simulation.configuration import to_settings
    from rpud_sim.simulation.ensemble import compile_kernels
    from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
    from rpud_sim.simulation.scenario_file import read_commands, read_scenario

    settings = to_settings(parameter_values(options))
    configuration, file = settings.configuration, settings.scenario
    faults = read_scenario(file, options.seed) if file else ()
    planned = read_commands(options.commands).changes if options.commands else ()
    compile_kernels(configuration, _show, messages=bool(options.bag))
    phases = initial_phases(options.repeat, options.seed)
    if options.bag:
        from rpud_sim.recorded.offline_bag import write_offline_bag

        beginning = Beginning(settings, phases[0], options.seed or 0, faults)
        plan = Plan(beginning, planned)
        text = Path(file).read_text(encoding="utf-8") if file else ""
        with progress_bar(" s", options.duration) as bar:
            write_offline_bag(options.bag, plan, options.duration, text, bar.update)
    figures = _figures(options, configuration, phases, (*faults, *planned))
    return {**figures, "scenario": file or None}


def _figures(
    options: Any,
    configuration: Configuration,
    phases: Sequence[float],
    planned: Sequence[Change],
) -> dict[str, Any]:
    from rpud_sim.drilling.rock import NO_DEEPER
    from rpud_sim.simulation.energy_account import mean_of
    from rpud_sim.simulation.ensemble import run_ensemble

    threads = len(os.sched_getaffinity(0))
    with progress_bar(" s", options.duration * options.repeat) as bar:
        ensemble = run_ensemble(
            configuration, options.duration, phases, bar.update, planned, threads
        )
    members = ensemble.members
    figures: dict[str, Any] = {
        **ensemble.mean(),
        "real_time_factor": ensemble.real_time_factor,
    }
    deepest = max(member.figures.get("depth") or 0.0 for member in members)
    if deepest >= configuration.parameters.tool_length:
        _show(NO_DEEPER)
    account = mean_of([member.account for member in members if member.account])
    figures["energy_account"] = account.to_dict()
    if feeds := [member.feed for member in members if member.feed]:
        figures["feed_account"] = mean_of(feeds).to_dict(account.weight_on_bit_work)
    if works := [member.rotation for member in members if member.rotation]:
        figures["rotation_account"] = dataclasses.asdict(mean_of(works))
    figures["regime"] = configuration.parameters.regime
    figures["repeat"] = options.repeat
    figures["seed"] = options.seed
    if options.repeat > 1:
        figures["standard_error"] = ensemble.standard_error()
    for group in ("parameters", "actuator", "rock", "rotation", "mount", "strata", "bit"):
        figures[group] = dataclasses.asdict(getattr(configuration, group))
    return figures


def _lines(figures: dict[str, Any]) -> Iterator[str]:
    from rpud_sim.simulation.statistics import FIGURES

    depth = {"depth": "m", "penetration_rate": "m/s"}
    errors = figures.get("standard_error", {})
    for name, unit in {"duration": "s", **FIGURES, **depth, "real_time_factor": ""}.items():
        if name in figures:
            error = cell(errors.get(name), ".2g", "")
            text = cell(figures[name], ".6g") + (error and f" +- {error}")
            yield f"{name:24} {text} {unit}".rstrip()


def _show(line: str) -> None:
    complain("rpud simulate", line)


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
    out=option(None, "write a new bag; with --live record it", metavar="DIR"),
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
