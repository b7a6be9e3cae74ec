"""``rpud simulate``: run the drill as fast as possible, without ROS, and print its figures."""

from __future__ import annotations

import argparse
import dataclasses
import gc
import importlib
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import (
    Number,
    add_json_argument,
    add_parameter_arguments,
    chosen_parameters,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.quantities import ParameterError, Quantity, shown
from rpud_sim.foundation.terminal import complain

if TYPE_CHECKING:
    from rpud_sim.simulation.changes import Planned
    from rpud_sim.simulation.configuration import Configuration
    from rpud_sim.simulation.scenario import Scenario

HELP = "run the drill offline, faster than real time, and print its figures"
EXAMPLE = "rpud simulate --regime drilling --duration 20 --set weight_on_bit=20 --json"

_DURATION = Quantity("s", "simulated time", 1e-9, 1e6)  # time is whole nanoseconds
_REPEAT = Quantity("", "number of runs", 1, 1e6, whole=True)
_SEED = Quantity("", "seed", 0, 2**63, whole=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_parameter_arguments(parser)
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=_DURATION,
        default=10.0,
        metavar="S",
        help="simulated time (default: %(default)s)",
    )
    parser.add_argument(
        "--repeat",
        action=Number,
        quantity=_REPEAT,
        default=1,
        metavar="N",
        help="an ensemble of N runs over initial vibration phases; adds standard errors",
    )
    parser.add_argument(
        "--seed",
        action=Number,
        quantity=_SEED,
        metavar="S",
        help="seed of the initial phases, and of the scenario in place of its own",
    )
    parser.add_argument(
        "--commands",
        metavar="FILE",
        help="commands and faults at their times, a YAML file as of rpud fork --commands",
    )
    parser.add_argument(
        "--bag", metavar="DIR", help="write the run as a bag with the topics of the node"
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    _load_numba()
    from rpud_sim.model.engine import EngineError

    errors: list[type[Exception]] = [EngineError]
    if arguments.bag:  # only then, for it takes long to load
        from rpud_sim.bag import BagError

        errors.append(BagError)
    if arguments.bag and arguments.repeat > 1:
        raise ParameterError("--bag goes with a single run, not with --repeat")
    _refuse_assignments_to_the_node(arguments)
    with failing(*errors):
        figures = _simulate(arguments)
    print_json(figures) if arguments.json else print(_text(figures))
    return ExitCode.DONE


def _load_numba() -> None:
    """Load Numba without SciPy's linear algebra, which no kernel uses: a fifth of the start.

    Python need not search what stays to the end for cycles.
    """
    if "scipy" not in sys.modules:
        sys.modules["scipy"] = None  # type: ignore[assignment]
        gc.disable()
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            del sys.modules["scipy"]
            gc.freeze()
            gc.enable()


def _refuse_assignments_to_the_node(arguments: argparse.Namespace) -> None:
    """Refuse parameters without effect here; a file may hold them, for the node reads it too."""
    from rpud_sim.simulation.configuration import NODE_NAMES
    from rpud_sim.simulation.parameter_files import parse_assignment

    for text in arguments.assignments:
        name, _ = parse_assignment(text)
        if name in NODE_NAMES and name != "scenario":
            raise ParameterError(f"{name} is a parameter of the drill node alone: see rpud run")


def _simulate(arguments: argparse.Namespace) -> dict[str, Any]:
    from rpud_sim.simulation.configuration import to_settings
    from rpud_sim.simulation.ensemble import compile_kernels, compile_members, initial_phases

    values = chosen_parameters(arguments)
    configuration = to_settings(values).configuration
    file = values.get("scenario", "")
    scenario = _scenario(file, arguments.seed)
    planned = _commands(arguments.commands)
    if arguments.bag or scenario or planned:
        compile_kernels(configuration, _show, messages=bool(arguments.bag))
    compile_members(configuration, _show)
    phases = initial_phases(arguments.repeat, arguments.seed)
    if arguments.bag:
        from rpud_sim.inspection.offline_bag import write_offline_bag
        from rpud_sim.simulation.run import Beginning

        beginning = Beginning(to_settings(values), phases[0], arguments.seed or 0, scenario)
        text = Path(file).read_text(encoding="utf-8") if scenario else ""
        with progress_bar(" s", arguments.duration) as bar:
            write_offline_bag(
                arguments.bag, beginning, arguments.duration, text, bar.update, planned
            )
    figures = _figures(arguments, configuration, phases, scenario, planned)
    figures["scenario"] = values.get("scenario") or None
    return figures


def _scenario(path: Any, seed: int | None) -> Scenario | None:
    from rpud_sim.simulation.scenario import read_scenario

    if not isinstance(path, str):
        raise ParameterError(f"scenario = {shown(path)} is not a text")
    return read_scenario(path, seed) if path else None


def _commands(path: str | None) -> Sequence[Planned]:
    from rpud_sim.simulation.changes import read_commands

    return read_commands(path).planned if path else ()


def _figures(
    arguments: argparse.Namespace,
    configuration: Configuration,
    phases: Sequence[float],
    scenario: Scenario | None,
    planned: Sequence[Planned],
) -> dict[str, Any]:
    from rpud_sim.drilling.rock import NO_DEEPER
    from rpud_sim.simulation.energy_account import mean_account, mean_feed_account
    from rpud_sim.simulation.ensemble import run_ensemble

    duration = arguments.duration
    total = duration * arguments.repeat
    with progress_bar(" s", total) as bar:
        threads = len(os.sched_getaffinity(0))
        ensemble = run_ensemble(
            configuration, duration, phases, bar.update, scenario, threads, planned
        )
    figures: dict[str, Any] = dict(ensemble.mean())
    figures["real_time_factor"] = ensemble.real_time_factor
    deepest = max(member.get("depth") or 0.0 for member in ensemble.members)
    if deepest >= configuration.parameters.tool_length:
        _show(NO_DEEPER)
    account = mean_account(list(ensemble.accounts))
    figures["energy_account"] = account.to_dict()
    if (feed := mean_feed_account(ensemble.feed_accounts)) is not None:
        figures["feed_account"] = feed.to_dict(account.weight_on_bit_work)
    if works := ensemble.rotor_works:
        figures["rotation_account"] = {
            name: math.fsum(getattr(work, name) for work in works) / len(works)
            for name in dataclasses.asdict(works[0])
        }
    figures["regime"] = configuration.parameters.regime
    figures["repeat"] = arguments.repeat
    figures["seed"] = arguments.seed
    if arguments.repeat > 1:
        figures["standard_error"] = ensemble.standard_error()
    figures["parameters"] = dataclasses.asdict(configuration.parameters)
    figures["actuator"] = dataclasses.asdict(configuration.actuator)
    figures["rock"] = dataclasses.asdict(configuration.rock)
    for group in ("rotation", "mount", "strata", "bit"):
        figures[group] = dataclasses.asdict(getattr(configuration, group))
    return figures


def _text(figures: dict[str, Any]) -> str:
    from rpud_sim.simulation.statistics import FIGURES

    units = {
        "duration": "s",
        **FIGURES,
        "depth": "m",
        "penetration_rate": "m/s",
        "real_time_factor": "",
    }
    errors = figures.get("standard_error", {})
    lines = []
    for name, unit in units.items():
        if name not in figures:
            continue
        value = figures[name]
        text = "-" if value is None else f"{value:.6g}"
        if errors.get(name) is not None:
            text += f" +- {errors[name]:.2g}"
        lines.append(f"{name:24} {text} {unit}".rstrip())
    return "\n".join(lines)


def _show(line: str) -> None:
    complain("rpud simulate", line)
