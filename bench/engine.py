"""The engine beside the best program in C that we could write, in turns within one run.

Times are the processor's, so that what else the machine does counts little. Every ratio is taken
between neighbours in time. The C program begins in the middle of a free motion of our trajectory.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from bench.table import ROOT, Row, row
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.drill import derive
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.configuration import Settings, with_defaults
from rpud_sim.simulation.ensemble import compile_kernels, run_members
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Block, Simulation

DURATION = 100  # of the runs [s]
PHASES = (0.0, 0.02, 0.04, 0.06, 0.08)  # of the turns [cycles]
STRIDE = 2  # simulated seconds between two collections of the results, which a cache holds
FLAGS = ("-O3", "-march=native", "-ffast-math")  # the fastest of those that gcc offers
_ENSEMBLE = {"drilling": 8.5e6, "free": 4.7e6}  # three times the rates of 0.2.0 [1/s]
_MEMBERS, _MEMBER_DURATION, _THREADS = 40, 10.0, 2
_LONG = 1e-4  # a free motion with time for another program's first step [s]
_COUNTED = 0.1  # slower blows are part of a contact that lasts, for programs without one [m/s]
_SAME = 1e-7  # how near two impacts are that agree [s]


class Run(NamedTuple):
    """Run of the engine."""

    used: float  # processor time [s]
    events: int
    start: tuple[float, ...]  # of the C program: phase [cycles], positions and velocities
    impact_times: np.ndarray  # that follow [s]


def engine() -> Iterator[Row]:
    """Time the engine and the C program in both regimes, each on one core."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        raise RuntimeError("the benchmark needs a C compiler: gcc or cc is not to be found")
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "drill")
        source = str(ROOT / "bench/c/drill.c")
        words = (compiler, "-std=gnu11", *FLAGS, "-o", str(program), source, "-lm")
        subprocess.run(words, check=True)
        for regime in ("drilling", "free"):
            yield from _beside_c(regime, preset(regime), program)


def _beside_c(regime: str, parameters: Parameters, program: Path) -> Iterator[Row]:
    compile_kernels(parameters)
    ours, in_c, agree = list[Run](), list[float](), list[int]()
    for phase in PHASES:
        ours.append(_run(parameters, phase))
        found = _run_in_c(program, parameters, ours[-1].start)
        in_c.append(found["cpu_time"])
        agree.append(_agreeing(ours[-1].impact_times, np.array(found["impact_times"])))
    name = f"engine, {regime}"
    yield row(f"{name}: times real time", [DURATION / run.used for run in ours])
    yield row(f"{name}: events on one core", [run.events / run.used for run in ours], "1/s")
    # The engine keeps the whole trajectory, the C program statistics only.
    ratios = [used / run.used for run, used in zip(ours, in_c, strict=True)]
    yield row(f"{name}: speed over C", ratios, least=1.0)
    yield row(f"{name}: impacts that agree within 0.1 us, C", agree)
    settings = Settings(with_defaults(parameters))
    phases = initial_phases(_MEMBERS, 1)
    plans = [Plan(Beginning(settings, phase)) for phase in phases]
    events = median(run.events / DURATION for run in ours) * _MEMBERS * _MEMBER_DURATION
    rates = []
    for _ in PHASES:
        began = time.process_time()
        list(run_members(plans, _MEMBER_DURATION, threads=_THREADS))
        rates.append(events / (time.process_time() - began))
    what = f"ensembles, {regime}: events per processor time"
    yield row(what, rates, "1/s", least=_ENSEMBLE[regime])


def _run(parameters: Parameters, phase: float) -> Run:
    simulation = Simulation(parameters, phase)
    used, events = 0.0, 0
    for end in range(STRIDE, DURATION + 1, STRIDE):
        began = time.process_time()
        block = simulation.advance_to(end * SECOND)
        used += time.process_time() - began
        events += len(block.segments)
    return Run(used, events, *_first_flight(block))


def _first_flight(block: Block) -> tuple[tuple[float, ...], np.ndarray]:
    """Return the state amid the first long free motion, and the impacts from there on."""
    flights = block.covering[block.covering["contact"] == 0]
    flight = flights[np.argmax(flights["duration"] > _LONG)]
    middle = 0.5 * float(flight["duration"])
    seconds, fraction = int(flight["start_seconds"]), float(flight["start_fraction"]) + middle
    at = block.sample(Times(np.array([seconds]), np.array([fraction])))
    phase = float(flight["vibration_phase"] + middle * flight["vibration_frequency"]) % 1.0
    names = ("nodal_plane", "free_mass")
    bodies = [getattr(at, f"{n}_{each}")[0] for n in names for each in ("position", "velocity")]
    bodies += [at.drill_tool_displacement[0], at.drill_tool_velocity[0]]
    impacts = block.impacts[block.impacts["impact_velocity"] > _COUNTED]
    times = (impacts["seconds"] - seconds) + (impacts["fraction"] - fraction)
    return (phase, *bodies), times[times > 0.0]


def _run_in_c(program: Path, parameters: Parameters, start: tuple[float, ...]) -> dict[str, Any]:
    drill = derive(parameters)
    numbers = (
        *(drill.in_rock, DURATION, *start),
        *(drill.rpud_mass, drill.rpud_damping, drill.load_spring_rate, drill.free_mass),
        *(drill.tool_mass, drill.tool_damping, drill.tool_spring_rate),
        *(drill.actuator_restitution, drill.drill_tool_restitution),
        *(parameters.weight_on_bit, parameters.gravity),
        *(parameters.vibration_amplitude, parameters.vibration_frequency),
    )
    words = [str(program), *(repr(float(number)) for number in numbers)]
    found: dict[str, Any] = json.loads(subprocess.check_output(words))
    return found


def _agreeing(ours: np.ndarray, theirs: np.ndarray) -> int:
    """Return how many impacts come at the same times until the first that does not."""
    count = min(len(ours), len(theirs))
    apart = np.abs(ours[:count] - theirs[:count]) > _SAME
    return int(np.argmax(apart)) if apart.any() else count
