"""The engine beside what one would use instead, in turns within one run.

Times are the processor's, so that what else the machine does counts little. Every ratio is taken
between neighbours in time; the table has the median, least and greatest of the turns.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from bench.drill_in_c import DrillInC
from bench.drill_in_scipy import Bodies, impact_times
from bench.row import Row, row
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Block, Simulation
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


def engine() -> Iterator[Row]:
    """Time the engine, C, SciPy and MuJoCo, each on one core."""
    for regime in ("drilling", "free"):
        yield from _beside(regime, preset(regime))


def _beside(regime: str, parameters: Parameters) -> Iterator[Row]:
    compile_kernels(parameters)
    speeds: dict[str, list[float]] = {}
    ours: list[Figures] = []
    in_c: dict[str, list[Figures]] = {"C": [], "C with strides": []}
    shared: list[float] = []
    mujoco = _mujoco(regime, parameters)

    def took(name: str, simulated: float, used: float) -> None:
        speeds.setdefault(name, []).append(simulated / used)

    with DrillInC() as program:
        for phase in PHASES:
            used, figures, block = _run(parameters, phase)
            took("rpud_sim", DURATION, used)
            ours.append(figures)
            for name, runs in in_c.items():
                runs.append(program.run(parameters, DURATION, phase, name != "C"))
                took(name, DURATION, runs[-1]["cpu_time"])
            used, same = _scipy(parameters, block)
            took("SciPy", SCIPY_DURATION, used)
            shared.append(same)
            if mujoco is not None:
                simulated = MUJOCO_STEPS * mujoco.step
                took("MuJoCo", simulated, mujoco.advance(simulated))
    for name, values in speeds.items():
        yield row(f"engine, {regime}: simulated seconds per second, {name}", values)
    for name, values in speeds.items():
        if name != "rpud_sim":
            pairs = zip(speeds["rpud_sim"], values, strict=True)
            ratios = [our / theirs for our, theirs in pairs]
            yield row(f"engine, {regime}: speed over that of {name}", ratios)
    for figure in SAME[regime]:
        for name, runs in in_c.items():
            ratios = [theirs[figure] / our[figure] for our, theirs in zip(ours, runs, strict=True)]
            yield row(f"engine, {regime}: {figure}, {name} over ours", ratios)
        if mujoco is not None:
            mean = float(np.mean([figures[figure] for figures in ours]))
            ratio = mujoco.figures()[figure] / mean
            yield row(f"engine, {regime}: {figure}, MuJoCo over ours", [ratio])
    yield row(f"engine, {regime}: first impact, SciPy less ours", shared, "s")


def _run(parameters: Parameters, phase: float) -> tuple[float, Figures, Block]:
    """Processor time of a run, its figures, and its last block."""
    simulation = Simulation(parameters, phase)
    statistics = Statistics()
    used = 0.0
    for end in range(STRIDE, DURATION + 1, STRIDE):
        began = time.process_time()
        block = simulation.advance_to(end * SECOND)
        used += time.process_time() - began
        statistics.add(block)
    figures = {name: value for name, value in statistics.figures().items() if value is not None}
    return used, figures, block


def _scipy(parameters: Parameters, block: Block) -> tuple[float, float]:
    """Processor time of SciPy from a flight in a block on, and how far its first impact is off."""
    flights = block.covering[block.covering["contact"] == 0]
    flight = flights[np.argmax(flights["duration"] > 1e-4)]
    middle = 0.5 * float(flight["duration"])
    seconds, fraction = int(flight["start_seconds"]), float(flight["start_fraction"]) + middle
    at = block.sample(Times(np.array([seconds]), np.array([fraction])))
    bodies = Bodies(
        at.nodal_plane_position[0],
        at.nodal_plane_velocity[0],
        at.free_mass_position[0],
        at.free_mass_velocity[0],
        at.drill_tool_displacement[0],
        at.drill_tool_velocity[0],
    )
    phase = float(flight["vibration_phase"] + middle * flight["vibration_frequency"])
    began = time.process_time()
    theirs = impact_times(parameters, bodies, phase, SCIPY_DURATION)
    used = time.process_time() - began
    times = (block.impacts["seconds"] - seconds) + (block.impacts["fraction"] - fraction)
    return used, abs(float(theirs[0] - times[times > 0.0][0]))


def _mujoco(regime: str, parameters: Parameters) -> DrillInMujoco | None:
    if importlib.util.find_spec("mujoco") is None:
        print("mujoco is not installed: its rows are left out", file=sys.stderr)
        return None
    from bench.drill_in_mujoco import TIME_STEPS, DrillInMujoco

    return DrillInMujoco(parameters, TIME_STEPS[regime])
