"""Ensembles: events per second on all cores, and runs of sweeps and fits beside former versions."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from bench.checkout import VERSION_0_1_0, Checkout, checkout, work_tree
from bench.quiet import undisturbed
from bench.row import Goal, Row, row

DURATION = 0.2  # of each run [s]
MEMBERS = 4000
TURNS = 5
BEFORE_FITS_WERE_COMPILED = "a308303"  # 0.1.0 has no fits

_SWEEP = """
design: latin_hypercube
points: {points}
repeat: 10
duration: {duration}
swept:
  weight_on_bit: {{minimum: 5, maximum: 20}}
  vibration_amplitude: {{minimum: 25.0e-6, maximum: 35.0e-6}}
"""
# The processor time of one run of a fit, as its workers run them, without the start.
_FIT = """
import sys, time
from rpud_sim.studies.fit.design import make_chunks, simulate
from rpud_sim.studies.fit.target_file import read_target_file
specification = read_target_file(sys.argv[1])
point = {name: 0.5 * (bounds.minimum + bounds.maximum)
         for name, bounds in specification.unknowns.items()}
chunks = make_chunks(specification, [point] * 40, 4, (1,))
simulate(chunks[0])
began = time.process_time()
for chunk in chunks:
    simulate(chunk)
print((time.process_time() - began) / 160)
"""


def ensembles() -> Iterator[Row]:
    """Time ensembles of both regimes, and sweeps and fits by turns with earlier versions."""
    for regime in ("drilling", "free"):
        rates = [undisturbed(partial(_events_per_second, regime)) for _ in range(TURNS)]
        name = f"ensemble, {regime}: events per second"
        yield row(f"{name}, all cores", [wall for wall, _ in rates], "1/s", Goal(least=3e6))
        yield row(f"{name} of processor time, one core", [own for _, own in rates], "1/s")
    with checkout(VERSION_0_1_0) as base, work_tree() as present:
        yield from _beside("sweep", "0.1.0", base, present, _time_of_sweep)
    with checkout(BEFORE_FITS_WERE_COMPILED) as base, work_tree() as present:
        yield from _beside("fit", BEFORE_FITS_WERE_COMPILED, base, present, _time_of_fit)


def _events_per_second(regime: str) -> tuple[float, float]:
    """Return events per second on all cores, and per second of processor time."""
    from rpud_sim.simulation import preset
    from rpud_sim.simulation.ensemble import compile_members, initial_phases, run_members

    parameters = preset(regime)
    compile_members(parameters)
    phases = initial_phases(MEMBERS, 1)
    threads = len(os.sched_getaffinity(0))
    began, spent = time.perf_counter(), time.process_time()
    found = list(run_members(parameters, DURATION, phases, threads=threads))
    used, spent = time.perf_counter() - began, time.process_time() - spent
    events = sum(int(member.figures["events"] or 0) for member in found)
    return events / used, events / spent


def _beside(
    name: str,
    version: str,
    base: Checkout,
    present: Checkout,
    measure: Callable[[Checkout], float],
) -> Iterator[Row]:
    pairs = [(measure(base), measure(present)) for _ in range(TURNS)]
    yield row(f"{name}: runs per second, {version}", [1.0 / old for old, _ in pairs], "1/s")
    yield row(f"{name}: runs per second", [1.0 / new for _, new in pairs], "1/s")
    ratios = [old / new for old, new in pairs]
    yield row(f"{name}: runs per second over those of {version}", ratios, "", Goal(least=3))


def _time_of_sweep(version: Checkout) -> float:
    """Return the wall time of a run in a sweep on all cores, without start and end [s]."""
    _sweep(version, 50)  # the first one finds nothing in the caches
    least, most = (_sweep(version, points) for points in (50, 3050))
    return (most - least) / 30_000


def _sweep(version: Checkout, points: int) -> float:
    with tempfile.TemporaryDirectory() as name:
        specification = Path(name, "sweep.yaml")
        specification.write_text(_SWEEP.format(points=points, duration=DURATION))
        return version.run(["rpud", "sweep", specification, "--out", Path(name, "out")]).wall


def _time_of_fit(version: Checkout) -> float:
    """Return the processor time of a run of a fit [s]."""
    file = version.tree / "config/fit_example.yaml"
    return float(version.run(["python", "-c", _FIT, file]).output)
