"""The engine beside what one would use instead, in turns within one run.

Times are the processor's, so that what else the machine does counts little. Every ratio is taken
between neighbours in time; the table has the median, least and greatest of the turns.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bench.drill_in_c import DrillInC
from bench.drill_in_scipy import impact_times
from bench.flight import COUNTED, Flight, agreeing, first_flight
from bench.row import Goal, Row, row
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

if TYPE_CHECKING:
    from bench.drill_in_mujoco import DrillInMujoco

DURATION = 100  # of the runs of the engine and of C [s]
SCIPY_DURATION = 0.02  # [s]
MUJOCO_STEPS = 2_500_000  # of each turn; its figures are those of all turns together
PHASES = (0.0, 0.02, 0.04, 0.06, 0.08)  # of the turns [cycles]
STRIDE = 10  # simulated seconds between two collections of the results

# What has to be the same for a comparison of speed to be fair. Before drilling the contact force
# is an estimate from the impact velocity.
SAME = {
    "drilling": ("drill_tool_impact_rate", "contact_force_mean", "reacting_force_mean"),
    "free": ("drill_tool_impact_rate", "impact_velocity_mean", "reacting_force_mean"),
}

Figures = dict[str, float]

# The engine keeps the whole trajectory, the C program statistics alone.
GOALS = {"C": Goal(least=1.5)}
# A change of the initial phase by its last digits, which shows how soon roundings part two runs.
ROUNDING = 1e-15  # [cycles]


def engine() -> Iterator[Row]:
    """Time the engine, C, SciPy and MuJoCo, each on one core."""
    for regime in ("drilling", "free"):
        yield from _beside(regime, preset(regime))


def _beside(regime: str, parameters: Parameters) -> Iterator[Row]:
    compile_kernels(parameters)
    speeds: dict[str, list[float]] = {}
    ours: list[Run] = []
    in_c: list[Figures] = []
    first: dict[str, list[float]] = {"C": [], "SciPy": []}
    agree: dict[str, list[int]] = {"C": [], "ours after a rounding": []}
    mujoco = _mujoco(regime, parameters)

    def took(name: str, simulated: float, used: float) -> None:
        speeds.setdefault(name, []).append(simulated / used)

    with DrillInC() as program:
        for phase in PHASES:
            ours.append(_run(parameters, phase))
            took("rpud_sim", DURATION, ours[-1].used)
            flight = ours[-1].flight
            figures, times = program.run(parameters, DURATION, flight)
            in_c.append(figures)
            took("C", DURATION, figures["cpu_time"])
            first["C"].append(abs(float(times[0] - flight.impact_times[0])))
            agree["C"].append(agreeing(flight.impact_times, times))
            agree["ours after a rounding"].append(_agreeing_after_rounding(parameters, phase))
            began = time.process_time()
            theirs = impact_times(parameters, flight.bodies, flight.phase, SCIPY_DURATION)
            took("SciPy", SCIPY_DURATION, time.process_time() - began)
            first["SciPy"].append(abs(float(theirs[0] - flight.impact_times[0])))
            if mujoco is not None:
                simulated = MUJOCO_STEPS * mujoco.step
                took("MuJoCo", simulated, mujoco.advance(simulated))
    for name, values in speeds.items():
        yield row(f"engine, {regime}: simulated seconds per second, {name}", values)
    rates = [run.events / run.used for run in ours]
    yield row(f"engine, {regime}: events per second on one core", rates, "1/s")
    for name, values in speeds.items():
        if name != "rpud_sim":
            pairs = zip(speeds["rpud_sim"], values, strict=True)
            ratios = [our / theirs for our, theirs in pairs]
            yield row(f"engine, {regime}: speed over that of {name}", ratios, goal=GOALS.get(name))
    for figure in SAME[regime]:
        ratios = [
            theirs[figure] / our.figures[figure] for our, theirs in zip(ours, in_c, strict=True)
        ]
        yield row(f"engine, {regime}: {figure}, C over ours", ratios)
        if mujoco is not None:
            mean = float(np.mean([our.figures[figure] for our in ours]))
            ratio = mujoco.figures()[figure] / mean
            yield row(f"engine, {regime}: {figure}, MuJoCo over ours", [ratio])
    for name, gaps in first.items():
        yield row(f"engine, {regime}: first impact, {name} less ours", gaps, "s")
    for name, counts in agree.items():
        yield row(f"engine, {regime}: impacts that agree within 0.1 us, {name}", counts)


class Run(NamedTuple):
    """Run of the engine: processor time [s], events, figures, and a flight to begin others from."""

    used: float
    events: int
    figures: Figures
    flight: Flight


def _run(parameters: Parameters, phase: float) -> Run:
    simulation = Simulation(parameters, phase)
    statistics = Statistics()
    used = 0.0
    events = 0
    for end in range(STRIDE, DURATION + 1, STRIDE):
        began = time.process_time()
        block = simulation.advance_to(end * SECOND)
        used += time.process_time() - began
        events += len(block.segments)
        statistics.add(block)
    figures = {name: value for name, value in statistics.figures().items() if value is not None}
    return Run(used, events, figures, first_flight(block))


def _agreeing_after_rounding(parameters: Parameters, phase: float) -> int:
    times = []
    for start in (phase, phase + ROUNDING):
        impacts = Simulation(parameters, start).advance_to(SECOND).impacts
        counted = impacts[impacts["impact_velocity"] > COUNTED]
        times.append(counted["seconds"] + counted["fraction"])
    return agreeing(*times)


def _mujoco(regime: str, parameters: Parameters) -> DrillInMujoco | None:
    if importlib.util.find_spec("mujoco") is None:
        print("mujoco is not installed: its rows are left out", file=sys.stderr)
        return None
    from bench.drill_in_mujoco import TIME_STEPS, DrillInMujoco

    return DrillInMujoco(parameters, TIME_STEPS[regime])
