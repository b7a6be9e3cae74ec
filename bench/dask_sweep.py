"""Sweeps past one machine: kills of workers and schedulers, and what a scheduler can serve.

Everything listens on 127.0.0.1 alone.
"""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.machine import used_by
from bench.row import Goal, Row, row

SIMULATIONS = 100_000
WANTED = 1_000_000
WORKERS = 2
NOTHING = 4_000  # chunks of which workers do nothing
WARMING = NOTHING // 10
MANY = 100  # workers to estimate for
_SWEEP = """
design: latin_hypercube
points: {points}
repeat: 10
duration: 0.2
swept:
  weight_on_bit: {{minimum: 5, maximum: 20}}
"""


class Processes:
    """A scheduler and its workers in processes of their own, which end with the context.

    Args:
        threads: of each worker, which run a chunk each at a time.
    """

    def __init__(self, threads: int = 1) -> None:
        self._threads = str(threads)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self._port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self._port}"
        self._scheduler: subprocess.Popen[bytes] | None = None
        self._workers: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Processes:
        """Start the scheduler and the workers."""
        self.start_scheduler()
        for _ in range(WORKERS):
            self.start_worker()
        return self

    def __exit__(self, *error: object) -> None:
        """End all that is left."""
        for process in (self._scheduler, *self._workers):
            _kill(process)

    def start_scheduler(self) -> None:
        """Start a scheduler, and wait until it listens."""
        self._scheduler = _start("scheduler", "--port", str(self._port))
        while True:
            try:
                socket.create_connection(("127.0.0.1", self._port)).close()
                return
            except OSError:
                time.sleep(0.05)

    def start_worker(self) -> None:
        """Start a worker."""
        words = (self.address, "--nthreads", self._threads, "--no-nanny")
        self._workers.append(_start("worker", *words))

    def served(self) -> tuple[float, float]:
        """Return the processor times of the scheduler and of this process [s]."""
        assert self._scheduler is not None
        return used_by(self._scheduler.pid), used_by(os.getpid())

    def kill_worker(self) -> None:
        """Kill one worker."""
        _kill(self._workers.pop())

    def kill_scheduler(self) -> None:
        """Kill the scheduler, and the workers with it, which cannot live without one."""
        _kill(self._scheduler)
        while self._workers:
            self.kill_worker()


def _start(kind: str, *words: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
    return subprocess.Popen(
        [*command, "--host", "127.0.0.1", "--no-dashboard"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _kill(process: subprocess.Popen[bytes] | None) -> None:
    if process is not None:
        process.send_signal(signal.SIGKILL)
        process.wait()


def dask() -> Iterator[Row]:
    """Kill a worker and restart the scheduler in a sweep, and measure what a scheduler serves."""
    yield from _interrupted()
    yield from _limit()


def _interrupted() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name, Processes() as cluster:
        specification, out = Path(name, "sweep.yaml"), Path(name, "out")
        specification.write_text(_SWEEP.format(points=SIMULATIONS // 10))
        words = ["rpud", "sweep", specification, "--out", out, "--json"]
        began = time.perf_counter()
        sweep = subprocess.Popen(
            [*words, "--scheduler", cluster.address], stdout=subprocess.PIPE, text=True
        )
        try:
            chunks = _chunk_count(out)
            _wait_for(sweep, out, chunks // 4)
            cluster.kill_worker()
            cluster.start_worker()
            _wait_for(sweep, out, chunks // 2)
            cluster.kill_scheduler()
            cluster.start_scheduler()
            for _ in range(WORKERS):
                cluster.start_worker()
            output, _ = sweep.communicate()
            used = time.perf_counter() - began
        finally:
            _kill(sweep)
        printed = json.loads(output)
        lost, twice = _lost_and_twice(out)
    name = f"Dask, {SIMULATIONS} runs, a worker killed, the scheduler restarted"
    yield row(f"{name}: runs lost", [lost], "", Goal(most=0))
    yield row(f"{name}: runs counted twice", [twice], "", Goal(most=0))
    yield row(f"{name}: runs that the command counts", [printed["run"]], "")
    yield row(f"{name}: wall time", [used], "s")
    yield row(
        f"Dask, {WANTED} runs on {WORKERS} workers: wall time, projected",
        [used * WANTED / SIMULATIONS / 3600.0],
        "h",
    )


def _chunk_count(out: Path) -> int:
    while not (out / "manifest.json").exists():
        time.sleep(0.05)
    return int(json.loads((out / "manifest.json").read_text())["chunks"])


def _wait_for(sweep: subprocess.Popen[str], out: Path, count: int) -> None:
    while len(list((out / "chunks").glob("*.arrow"))) < count:
        if sweep.poll() is not None:
            raise RuntimeError(f"the sweep ended with {sweep.returncode}")
        time.sleep(0.02)


def _lost_and_twice(out: Path) -> tuple[int, int]:
    """Return how many simulations the table lacks, and how many it has more than once."""
    import pyarrow.parquet as pq

    table = pq.read_table(out / "simulations.parquet", columns=["point", "member"])
    numbers = table["point"].to_numpy() * 10 + table["member"].to_numpy()
    counts = np.bincount(numbers, minlength=SIMULATIONS)
    return int(np.count_nonzero(counts == 0)), int(np.count_nonzero(counts > 1))


def do_nothing(chunk: object) -> object:
    """Return an outcome as large as a chunk's, without simulating anything."""
    from rpud_sim.simulation.statistics import FIGURES
    from rpud_sim.studies.sweep.chunks import Outcome

    count = chunk.count  # type: ignore[attr-defined]
    return Outcome(np.zeros(count), np.zeros((count, len(FIGURES))), (None,) * count, ({},) * count)


def _limit() -> Iterator[Row]:
    """Serve as many threads as there would be workers, of which none simulates anything.

    Workers have processors of their own: what bounds their number is the busier one of scheduler
    and sweep, which serve all of them.
    """
    from rpud_sim.studies.cluster import run_on_cluster
    from rpud_sim.studies.sweep.chunks import make_chunks, simulate
    from rpud_sim.studies.sweep.design import design_points
    from rpud_sim.studies.sweep.folder import SweepFolder
    from rpud_sim.studies.sweep.specification_file import parse_specification

    specification = parse_specification(
        {
            "design": "latin_hypercube",
            "points": WANTED // 10,
            "repeat": 10,
            "duration": 0.2,
            "swept": {"weight_on_bit": {"minimum": 5.0, "maximum": 20.0}},
        }
    )
    made = list(make_chunks(specification, design_points(specification)))
    chunks = [
        dataclasses.replace(made[number % len(made)], number=number) for number in range(NOTHING)
    ]
    simulate(chunks[0])
    began = time.process_time()
    simulate(chunks[1])
    each = time.process_time() - began
    os.environ["PYTHONPATH"] = os.pathsep.join(["", *sys.path])  # of the workers: this file
    with tempfile.TemporaryDirectory() as name, Processes(MANY // WORKERS) as cluster:
        folder = SweepFolder(Path(name), specification)
        with folder.held():
            outcomes = run_on_cluster(chunks, cluster.address, do_nothing)
            for number, (chunk, outcome) in enumerate(outcomes):
                folder.add(chunk, outcome)
                if number == WARMING:
                    began, before = time.perf_counter(), cluster.served()
            served = NOTHING - 1 - WARMING
            rate = served / (time.perf_counter() - began)
            costs = [
                (now - then) / served for now, then in zip(cluster.served(), before, strict=True)
            ]
    busiest = max(costs)
    yield row("Dask: chunks per second, with all on this machine", [rate], "1/s")
    yield row("Dask: processor time of a chunk", [each], "s")
    yield row("Dask: processor time of the scheduler for a chunk", [costs[0]], "s")
    yield row("Dask: processor time of the sweep for a chunk", [costs[1]], "s")
    yield row("Dask: workers that this keeps busy", [each / busiest], "", Goal(least=MANY))
    runs = min(1.0 / busiest, MANY / each) * made[0].count
    yield row(f"Dask, {WANTED} runs on {MANY} workers: wall time, estimated", [WANTED / runs], "s")
