"""Sweeps: any points, any executor, the same bits; a failure costs its own row alone."""

import os
import signal
import subprocess
import sys
from concurrent.futures import Future

import numpy as np
import pandas
import pytest

import rpud_sim
from rpud_sim.model.engine import EngineError
from rpud_sim.scripting.runs import DrillRun

GRID = {"weight_on_bit": [5.0, 20.0], "contact_model": ["given", "rayleigh"]}


class Here:
    """Executor in this process, with nothing but ``submit``."""

    def submit(self, function, *arguments):
        future = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


class Lossy(Here):
    """Executor whose first worker dies."""

    lost = False

    def submit(self, *words):
        future = super().submit(*words)
        if not self.lost:
            self.lost = True
            future = Future()
            future.set_exception(MemoryError("worker 1 ran out of memory\nand died"))
        return future


@pytest.fixture(scope="module")
def grid():
    return rpud_sim.sweep(GRID, 0.5, seeds=2)


def test_a_grid_has_a_row_for_each_combination_and_seed(grid):
    assert len(grid) == 8
    assert list(grid)[:3] == ["weight_on_bit", "contact_model", "seed"]
    assert list(grid)[-1] == "failure"
    assert grid["seed"].tolist() == 4 * [0, 1]
    assert grid["contact_model"].tolist() == 2 * ["given", "given", "rayleigh", "rayleigh"]
    assert grid["failure"].isna().all()
    assert grid.attrs["units"]["weight_on_bit"] == "N"
    assert grid.attrs["units"]["drill_tool_impact_rate"] == "1/s"


def test_each_row_is_the_run_that_simulate_gives(grid):
    for _, row in grid.iterrows():
        drill = {name: row[name] for name in GRID}
        figures = rpud_sim.simulate(0.5, seed=row["seed"], **drill).metrics
        for name in list(grid)[3:-1]:
            assert row[name] == figures[name], name


def test_rows_a_frame_and_another_executor_give_the_same_bits(grid):
    rows = [
        {"weight_on_bit": w, "contact_model": m} for w in (5.0, 20.0) for m in GRID["contact_model"]
    ]
    listed = rpud_sim.sweep(rows, 0.5, seeds=[0, 1], executor=Here())
    framed = rpud_sim.sweep(pandas.DataFrame(rows), 0.5, seeds=2, executor=Here())
    pandas.testing.assert_frame_equal(listed, grid, check_exact=True)
    pandas.testing.assert_frame_equal(framed, grid, check_exact=True)


def test_a_point_takes_what_simulate_takes():
    points = [{}, {"faults": "free_mass_jammed"}, {"rock_model": "specific_energy"}]
    frame = rpud_sim.sweep(points, 0.5, executor=Here())
    healthy, jammed, rock = frame["energy_absorbed_rate"]
    assert healthy == rock != jammed
    assert np.isnan(frame["depth"][0])
    assert frame["depth"][2] > 0.0


def test_a_failed_run_keeps_the_others_and_says_why(monkeypatch):
    class Failing(DrillRun):
        @property
        def metrics(self):
            if self.parameters["weight_on_bit"] == 20.0:
                raise EngineError("no event after\n1 s")
            return super().metrics

    monkeypatch.setattr("rpud_sim.scripting.runs.DrillRun", Failing)
    frame = rpud_sim.sweep({"weight_on_bit": [5.0, 20.0, 30.0]}, 0.2, executor=Here())
    assert frame["failure"].tolist() == [None, "no event after 1 s", None]
    assert frame["events"].isna().tolist() == [False, True, False]


def test_a_lost_worker_costs_its_own_rows():
    frame = rpud_sim.sweep({"weight_on_bit": range(5, 9)}, 0.2, executor=Lossy())
    assert frame["failure"][0] == "worker 1 ran out of memory and died"
    assert frame["failure"][1:].isna().all()
    again = frame[frame["failure"].notna()][["weight_on_bit"]]
    assert rpud_sim.sweep(again, 0.2, executor=Here())["failure"].isna().all()


@pytest.mark.parametrize(
    ("points", "words", "text"),
    [
        ({"weight": [1]}, {}, "point 0: weight is not a parameter; did you mean weight_on_bit"),
        ([{}, {"weight_on_bit": -1}], {}, "point 1: weight_on_bit = -1 N is outside its range"),
        ({"weight_on_bit": [1.0, np.nan]}, {}, "point 1: weight_on_bit = nan"),
        ({"faults": ["jammed"]}, {}, "point 0: .*jammed"),
        ({"seed": [1]}, {}, "point 0: seed is not a parameter of a point"),
        ({"duration": [1]}, {}, "point 0: .* is not what rpud_sim.simulate takes"),
        ({}, {"seeds": 0}, "seeds = 0 is outside its range"),
        ({}, {"duration": -1}, "duration = -1 s is outside"),
        ([], {}, "there are none"),
        (5, {}, "points = 5 are not mappings"),
    ],
)
def test_what_cannot_be_used_is_one_line_before_anything_runs(points, words, text):
    words = {"duration": 1.0, "executor": None, **words}
    with pytest.raises(rpud_sim.ParameterError, match=text) as error:
        rpud_sim.sweep(points, **words)
    assert "\n" not in str(error.value)


# The workers do not run it again, although it has no guard.
KILLED = """
import os, rpud_sim
print(os.getpid(), flush=True)
rpud_sim.sweep({"weight_on_bit": range(5, 10)}, 3000.0)
"""


@pytest.mark.extended
def test_the_processes_end_with_a_killed_caller(tmp_path):
    (tmp_path / "script.py").write_text(KILLED)
    with subprocess.Popen(
        [sys.executable, tmp_path / "script.py"], stdout=subprocess.PIPE, start_new_session=True
    ) as caller:
        caller.stdout.readline()
        # Standard output stays open as long as any of them lives.
        workers = min(len(os.sched_getaffinity(0)), 5)
        while len(members(caller.pid)) < 3 + workers:  # also those that begin and watch them
            assert caller.poll() is None
        os.kill(caller.pid, signal.SIGKILL)
        assert caller.stdout.read() == b""


def members(session):
    """Return the processes of a session."""
    found = subprocess.run(["ps", "-o", "pid=", "-s", str(session)], capture_output=True, text=True)
    return found.stdout.split()


@pytest.mark.extended
def test_a_dask_cluster_gives_the_same_bits(optional_packages, grid):
    distributed = pytest.importorskip("distributed")
    quiet = {"dashboard_address": None, "silence_logs": 50}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **quiet) as cluster,
        distributed.Client(cluster) as client,
    ):
        frame = rpud_sim.sweep(GRID, 0.5, seeds=2, executor=client)
    pandas.testing.assert_frame_equal(frame, grid, check_exact=True)
