"""Bags of earlier releases: each command that reads them does, and none computes them again.

Their parameter files load.

`offline_free` is a run without ROS before drilling, `run` a drill in real time from its start on,
and `stepped` one that was stepped, commanded, reconfigured and given faults, with a resonant
actuator and a rock model. `arm` was stepped on an arm, with strata and rotation, and reset.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import rpud_sim.bag
from rpud_sim.simulation.versions import ENGINE
from rpud_sim.viewer.recorded import RecordedStore

DATA = Path(__file__).parents[1] / "data"
ENGINES = {"0.1.0": 1, "0.2.0": 3}
BAGS = sorted(DATA.glob("*/*"))
PARAMETER_FILES = sorted(DATA.glob("*.yaml"))
every_bag = pytest.mark.parametrize("bag", BAGS, ids=lambda bag: f"{bag.parent.name}-{bag.name}")


@every_bag
def test_verify_and_fork_say_which_release_proves_it(bag, tmp_path, rpud):
    release = f"rpud_sim {bag.parent.name}"
    reason = (
        f"/rpud/journal: made by engine {ENGINES[bag.parent.name]} of {release}; "
        f"this is engine {ENGINE}: {release} proves it\n"
    )
    assert rpud("verify", bag) == (1, "", f"rpud verify: {reason}")
    fork = ("fork", bag, "--at", 0.01, "--out", tmp_path / "fork")
    assert rpud(*fork) == (1, "", f"rpud fork: {reason}")
    assert not (tmp_path / "fork").exists()


@every_bag
def test_it_is_listed_reported_and_exported(bag, tmp_path, rpud):
    code, out, err = rpud("info", bag, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["message_count"] > 90
    assert rpud("report", bag, "--out", tmp_path / "report.html")[0] == 0
    out = tmp_path / "tables"
    assert rpud("export", bag, "--out", out)[::2] == (0, "")
    force = pq.read_table(out / "rpud.contact_force.parquet")["peak_force"].to_numpy()
    with rpud_sim.bag.open(bag) as held:
        np.testing.assert_array_equal(force, held.arrays("/rpud/contact_force")["peak_force"])


@every_bag
def test_temperatures_are_kelvin_and_powers_those_of_the_status(bag):
    with rpud_sim.bag.open(bag) as held:
        units = {column.name: column.unit for column in held.columns("/rpud/status")}
        values = held.arrays("/rpud/status")["actuator_temperature"]
    assert (units["actuator_temperature"], np.floor(values[0])) == ("K", 293.0)
    with RecordedStore(bag) as store:
        store.read_all()
        history = store.histories["/rpud"]
        assert history.signal("temperature") is None  # which is shown in degrees Celsius
        own = [each.unit for each in history.others() if "temperature" in each.name]
        assert {*own} == {"K"}
        assert history.signal("lateness").source == "Status.lateness_max"
        if bag.parent.name == "0.2.0":  # 0.1.0 has none
            assert history.signal("absorbed_power").source == "Status.absorbed_power"


def test_it_is_compared_with_a_bag_of_today(tmp_path, rpud):
    bag = DATA / "0.2.0" / "offline_free"
    simulate = ("simulate", "--regime", "free", "--duration", 2, "--bag", tmp_path / "new")
    assert rpud(*simulate)[0] == 0
    printed = rpud("compare", bag, tmp_path / "new", "--settle", 0, "--json")[1]
    found = json.loads(printed)
    assert "ambient_temperature" not in {each["name"] for each in found["parameters"]}
    timing = [run["timing"]["greatest"]["real_time_factor"] for run in found["runs"]]
    assert timing == [1.0, None]  # what is computed offline has none


@every_bag
def test_its_waveform_is_rebuilt_from_its_trajectory(bag, tmp_path, rpud):
    with rpud_sim.bag.open(bag) as held:
        waveform = held.arrays("/rpud/waveform")
    rate = round(1.0 / waveform["sample_period"][0])
    out = tmp_path / "tables"
    rebuild = ("export", bag, "--out", out, "--rate", rate)
    assert rpud(*rebuild)[::2] == (0, "")
    # A reset begins the stamps again; the export has the first run.
    resets = np.flatnonzero(np.diff(waveform["time"]) < 0)
    recorded = slice(None, resets[0] + 1 if len(resets) else None)
    found = pq.read_table(out / "rpud.trajectory.parquet")
    table = {name: found[name].to_numpy() for name in found.column_names}
    table["time"] = table["time"].astype(np.int64)
    times, here, there = np.intersect1d(
        waveform["time"][recorded], table["time"], return_indices=True
    )
    assert len(times) > 100
    for name, values in table.items():
        if name in waveform and name != "time":
            size = np.abs(waveform[name]).max()
            np.testing.assert_allclose(
                values[there], waveform[name][here], rtol=1e-9, atol=1e-9 * size
            )


@pytest.mark.parametrize("file", PARAMETER_FILES, ids=lambda file: file.name)
def test_a_parameter_file_of_an_earlier_release_drills(file, rpud):
    code, printed, error = rpud("simulate", "--config", file, "--duration", "0.05")
    assert (code, error) == (0, "")
    assert "drill_tool_impact_rate" in printed
