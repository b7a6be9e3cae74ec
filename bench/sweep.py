"""How sweeps scale: with the number of workers, and with the number of simulations."""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench.row import Row, row

SIMULATIONS = (1_000, 10_000, 100_000)
DURATION = 0.2  # of each simulation [s]
PAIRS = 5


def cost(simulations: int, workers: int) -> float:
    """Return the wall time per simulation of a sweep [s].

    From the first outcome on, to leave out the start of the workers, and up to both tables.
    """
    from rpud_sim.studies.processes import run_on_processes
    from rpud_sim.studies.sweep.chunks import make_chunks, simulate
    from rpud_sim.studies.sweep.design import design_points
    from rpud_sim.studies.sweep.folder import SweepFolder
    from rpud_sim.studies.sweep.specification_file import parse_specification

    specification = parse_specification(
        {
            "design": "latin_hypercube",
            "points": simulations // 10,
            "repeat": 10,
            "duration": DURATION,
            "swept": {
                "weight_on_bit": {"minimum": 5.0, "maximum": 20.0},
                "vibration_amplitude": {"minimum": 25e-6, "maximum": 35e-6},
            },
        }
    )
    design = design_points(specification)
    counted, started = 0, 0.0
    with tempfile.TemporaryDirectory() as out:
        folder = SweepFolder(Path(out), specification)
        with folder.held():
            for chunk, outcome in run_on_processes(
                simulate, make_chunks(specification, design), workers
            ):
                folder.add(chunk, outcome)
                counted += chunk.count if started else 0
                started = started or time.perf_counter()
            folder.complete_tables()
    return (time.perf_counter() - started) / counted


def sweeps() -> Iterator[Row]:
    """Time sweeps with one and two workers in turn, and of growing size with two."""
    cost(SIMULATIONS[0], 1)  # compiles
    pairs = [(cost(10 * SIMULATIONS[0], 1), cost(10 * SIMULATIONS[0], 2)) for _ in range(PAIRS)]
    yield row("sweep: efficiency of two workers", [one / two / 2.0 for one, two in pairs], "")
    for simulations in SIMULATIONS:
        values = [1e3 * cost(simulations, 2) for _ in range(1 if simulations > 10_000 else PAIRS)]
        yield row(f"sweep of {simulations} simulations: each", values, "ms")
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        yield row(f"sweep of {simulations} simulations: peak memory of the bench", [memory], "MiB")
