"""The engine beside the best program in C that we could write, in turns within one run.

Times are the processor's, so that what else the machine does counts little. Every ratio is taken
between neighbours in time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from statistics import median
from typing import NamedTuple

from bench.drill_in_c import DrillInC
from bench.flight import Flight, agreeing, first_flight
from bench.table import Goal, Row, row
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.configuration import Settings, whole_configuration
from rpud_sim.simulation.ensemble import compile_kernels, run_members
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.simulation import Simulation

DURATION = 100  # of the runs [s]
PHASES = (0.0, 0.02, 0.04, 0.06, 0.08)  # of the turns [cycles]
STRIDE = 2  # simulated seconds between two collections of the results, which a cache holds

# What has to be the same for a comparison of speed to be fair. Before drilling the contact force
# is an estimate from the impact velocity.
SAME = {
    "drilling": ("drill_tool_impact_rate", "contact_force_mean", "reacting_force_mean"),
    "free": ("drill_tool_impact_rate", "impact_velocity_mean", "reacting_force_mean"),
}
# Three times those of 0.2.0 [1/s]. The energy account of each member is wanted.
_ENSEMBLE = {"drilling": Goal(least=8.5e6), "free": Goal(least=4.7e6)}
_MEMBERS = 40
_MEMBER_DURATION = 10.0  # [s]
_THREADS = 2
_OVER_C = Goal(least=1.0)  # the engine keeps the whole trajectory, the C program statistics only


class Run(NamedTuple):
    """Run of the engine."""

    used: float  # processor time [s]
    events: int
    figures: dict[str, float]
    flight: Flight  # where the C program begins


def engine() -> Iterator[Row]:
    """Time the engine and the C program in both regimes, each on one core."""
    for regime in ("drilling", "free"):
        yield from _beside_c(regime, preset(regime))


def _beside_c(regime: str, parameters: Parameters) -> Iterator[Row]:
    compile_kernels(parameters)
    ours: list[Run] = []
    in_c: list[dict[str, float]] = []
    first: list[float] = []
    agree: list[int] = []
    with DrillInC() as program:
        for phase in PHASES:
            ours.append(_run(parameters, phase))
            flight = ours[-1].flight
            figures, times = program.run(parameters, DURATION, flight)
            in_c.append(figures)
            first.append(abs(float(times[0] - flight.impact_times[0])))
            agree.append(agreeing(flight.impact_times, times))
    pairs = list(zip(ours, in_c, strict=True))
    name = f"engine, {regime}"
    speeds = [DURATION / run.used for run in ours]
    yield row(f"{name}: simulated seconds per second, rpud_sim", speeds)
    speeds = [DURATION / figures["cpu_time"] for figures in in_c]
    yield row(f"{name}: simulated seconds per second, C", speeds)
    rates = [run.events / run.used for run in ours]
    yield row(f"{name}: events per second on one core", rates, "1/s")
    ratios = [figures["cpu_time"] / run.used for run, figures in pairs]
    yield row(f"{name}: speed over that of C", ratios, goal=_OVER_C)
    settings = Settings(whole_configuration(parameters))
    phases = initial_phases(_MEMBERS, 1)
    plans = [Plan(Beginning(settings, phase)) for phase in phases]
    events = median(run.events / DURATION for run in ours) * _MEMBERS * _MEMBER_DURATION
    rates = []
    for _ in PHASES:
        began = time.process_time()
        list(run_members(plans, _MEMBER_DURATION, threads=_THREADS))
        rates.append(events / (time.process_time() - began))
    goal = _ENSEMBLE[regime]
    yield row(f"ensembles, {regime}: events per second of processor time", rates, "1/s", goal=goal)
    for figure in SAME[regime]:
        ratios = [figures[figure] / run.figures[figure] for run, figures in pairs]
        yield row(f"{name}: {figure}, C over ours", ratios)
    yield row(f"{name}: first impact, C less ours", first, "s")
    yield row(f"{name}: impacts that agree within 0.1 us, C", agree)


def _run(parameters: Parameters, phase: float) -> Run:
    simulation = Simulation(parameters, phase)
    metrics = Metrics()
    used = 0.0
    events = 0
    for end in range(STRIDE, DURATION + 1, STRIDE):
        began = time.process_time()
        block = simulation.advance_to(end * SECOND)
        used += time.process_time() - began
        events += len(block.segments)
        metrics.add(block)
    figures = {name: value for name, value in metrics.values().items() if value is not None}
    return Run(used, events, figures, first_flight(block))
