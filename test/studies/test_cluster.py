"""A cluster that loses a worker and its scheduler: every chunk has one outcome, none has two."""

import contextlib
import socket
import subprocess
import sys
import time

import pytest
from plain_values import parse_specification

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.studies import workers
from rpud_sim.studies.sweep.sweep import design_points, make_chunks, simulate
from rpud_sim.studies.workers import WorkerError, run_chunks

pytestmark = pytest.mark.extended

SPECIFICATION = parse_specification(
    {
        "design": "grid",
        "repeat": 2,
        "duration": 5.0,
        "swept": {"weight_on_bit": [5.0 + number for number in range(12)]},
    }
)
CHUNKS = list(make_chunks(SPECIFICATION, design_points(SPECIFICATION)))


class Cluster:
    """Scheduler and workers in processes, on 127.0.0.1 alone."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes = {}

    def start(self, name, kind, *words):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words]
        self.processes[name] = subprocess.Popen(
            [*command, "--host", "127.0.0.1", "--no-dashboard"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def start_scheduler(self):
        self.start("scheduler", "scheduler", "--port", str(self.port))
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            with contextlib.suppress(OSError):
                return socket.create_connection(("127.0.0.1", self.port)).close()
            assert self.processes["scheduler"].poll() is None
        raise AssertionError("the scheduler does not listen")

    def start_worker(self, name):
        self.start(name, "worker", self.address, "--nthreads", "1", "--no-nanny")

    def end(self, name):
        process = self.processes.pop(name)
        process.kill()
        process.wait()


@pytest.fixture
def dask():
    made = Cluster()
    yield made
    for name in [*made.processes]:
        made.end(name)


def test_a_port_that_accepts_and_stays_silent_is_one_line(monkeypatch):
    monkeypatch.setattr(workers, "CONNECT_TIMEOUT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(WorkerError, match=r"no answer of a Dask scheduler in 0\.5 s"):
            list(run_chunks(simulate, CHUNKS, 1, address))


@pytest.mark.parametrize("address", ["a:1", "http://a:1", "tcp://a", "tcp://a:99999", "tcp://[a:1"])
def test_what_is_no_address_is_a_wrong_call(address):
    with pytest.raises(ParameterError, match="--scheduler = "):
        list(run_chunks(simulate, CHUNKS, 1, address))


def test_a_killed_worker_and_a_restarted_scheduler_lose_and_repeat_nothing(dask, capfd):
    assert len(CHUNKS) > 10
    dask.start_scheduler()
    dask.start_worker("first")
    dask.start_worker("second")
    found = {}
    for chunk, outcome in run_chunks(simulate, CHUNKS, 1, dask.address):
        assert chunk.number not in found
        found[chunk.number] = outcome
        if len(found) == 2:
            dask.end("first")
        if len(found) == 5:
            dask.end("scheduler")
            dask.end("second")
            dask.start_scheduler()
            dask.start_worker("third")
    assert sorted(found) == [chunk.number for chunk in CHUNKS]
    assert "Traceback" not in capfd.readouterr().err
    for chunk in (CHUNKS[0], CHUNKS[-1]):
        assert found[chunk.number].table.equals(simulate(chunk).table)


def test_a_scheduler_that_stays_away_ends_the_sweep_in_one_line(dask, monkeypatch):
    monkeypatch.setattr(workers, "RESTART_TIMEOUT", 0.0)
    monkeypatch.setattr(workers, "CONNECT_TIMEOUT", 1.0)

    def chunks():
        for chunk in CHUNKS:
            yield chunk
            if chunk.number == 0:
                dask.end("scheduler")

    dask.start_scheduler()
    with pytest.raises(WorkerError, match=r"^--scheduler tcp://127.0.0.1:\d+: cannot be reached"):
        list(run_chunks(simulate, chunks(), 1, dask.address))
