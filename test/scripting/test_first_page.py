"""The listing of the package's first page: simulate, look, save, open."""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recorded_bags import SECOND, ForceRecorder
from support import extended

import rpud_sim
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.plan import Beginning

CONFIG = Path(__file__).parents[2] / "config"
ARM = {"feed_model": "arm", "rotation_model": "friction_drive", "initial_feed": 0.001}


@pytest.fixture(scope="module")
def run():
    return rpud_sim.simulate(2, weight_on_bit=20, seed=3)


def equal(one, other):
    return all(
        np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f")
        if one[name].dtype != object
        else str(one[name].tolist()) == str(other[name].tolist())
        for name in one
    )


def test_the_face_has_eleven_names_and_a_version():
    assert len(rpud_sim.__all__) == 11
    assert all(getattr(rpud_sim, name) is not None for name in rpud_sim.__all__)
    assert rpud_sim.__version__[0].isdigit()
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        rpud_sim.simulat  # noqa: B018


def test_columns_have_units_and_times(run):
    impacts = run["contact_force"]
    assert len(impacts["peak_force"]) > 500
    assert impacts.units["peak_force"] == "N"
    assert (np.diff(run.times("contact_force")) > 0).all()
    frame = run.frame("reacting_force")
    assert frame.index[-1] == 2.0
    assert frame.attrs["units"]["force"] == "N"
    assert frame["force"].mean() == pytest.approx(run["reacting_force"]["force"].mean())
    assert [*run] == list(run.topics)


def test_a_waveform_has_any_rate_and_meets_the_samples(run):
    waveform = run.waveform(100)
    assert waveform["time"][-1] == 1.99
    assert (waveform["reacting_force"][1:] == run["reacting_force"]["force"][:-1]).all()
    part = run.waveform(33_333, start=0.5, duration=0.1)
    assert part["time"][0] == pytest.approx(0.5, abs=1 / 33_333)
    assert len(part["time"]) == 3333
    assert part.units["drill_tool_velocity"] == "m/s"
    # Times are compared as whole nanoseconds: 1.1 * 10 and 0.29 * 100 round to the wrong side.
    assert run.waveform(10, start=1.1)["time"][0] == 1.1
    assert run.waveform(100, duration=0.29)["time"][-1] == 0.28
    parts = [run.waveform(7_777, start=n / 10, duration=0.1)["time"] for n in range(20)]
    assert (np.concatenate(parts) == run.waveform(7_777)["time"]).all()


def test_times_before_a_pause_count_from_the_origin_of_then(tmp_path):
    recorder, step, pause = ForceRecorder(tmp_path / "bag"), SECOND // 100, 60 * SECOND
    recorder.tell(0, "begin", 0, 0, **Beginning(Settings()).to_journal())
    recorder.tell(0, "origin", 0, 0, origin=0)
    recorder.write([(n * step, n * step, 1.0) for n in range(100)])
    recorder.tell(SECOND + pause, "origin", SECOND + pause, SECOND, origin=pause)
    recorder.write([(n * step + pause + 1, n * step + pause, 1.0) for n in range(100, 200)])
    recorder.close()
    with rpud_sim.open(recorder.path) as bag:
        times = bag.runs[0].times("reacting_force")
    assert times == pytest.approx(np.arange(200) / 100)


def test_runs_in_memory_are_verified_and_compared(tmp_path):
    run, other = rpud_sim.simulate(1.0), rpud_sim.simulate(1.0, weight_on_bit=20.0)
    assert rpud_sim.verify(run).proved
    [setting] = rpud_sim.compare(run, other).settings
    assert (setting.name, setting.values) == ("weight_on_bit", ("8", "20"))
    with rpud_sim.open(run.save(tmp_path / "bag")) as bag:
        assert rpud_sim.compare([bag.runs[0], other]).settings == (setting,)
        assert rpud_sim.compare(bag.runs[0], run).settings == ()


@pytest.mark.parametrize("values", [{}, extended(ARM)])
def test_a_saved_run_has_the_same_face_and_is_proved(tmp_path, values):
    faults = ["lost_preload", {"kind": "noise", "channel": "wrench", "onset": 0.2}]
    run = rpud_sim.simulate(1.013, seed=5, faults=faults, **values)
    run.save(tmp_path / "bag")
    with rpud_sim.open(tmp_path / "bag") as bag:
        assert rpud_sim.verify(bag).proved
        [recorded] = bag.runs
        assert (recorded.duration, recorded.seed) == (1.013, 5)
        assert recorded.parameters == run.parameters
        assert str(recorded.metrics) == str(run.metrics)
        assert recorded.topics == run.topics
        for topic in run.topics:
            assert equal(run[topic], recorded[topic]), topic
        with pickle.loads(pickle.dumps(bag)) as copy:
            assert equal(copy.runs[0]["wrench"], run["wrench"])
        assert equal(run.waveform(1000), recorded.waveform(1000))
        frame = bag.frame("/rpud/reacting_force", index="header.stamp")
        assert (frame.index.name, frame.attrs["units"]["force"]) == ("header.stamp", "N")


@pytest.mark.extended
def test_it_draws_itself(run):
    assert len(run.plot().axes) == 4
    shown = run._repr_html_()
    assert "drill_tool_impact_rate" in shown
    assert "data:image/png" in shown
    assert len(shown) < 200_000


def test_objects_show_themselves_in_a_line(run, tmp_path):
    assert repr(run["reacting_force"]) == (
        "<Columns of 200 rows: header.stamp [ns], header.frame_id, force [N], impacts>"
    )
    run.save(tmp_path / "bag")
    with rpud_sim.open(tmp_path / "bag") as bag:
        assert repr(bag) == f"<DrillBag {tmp_path / 'bag'}: {len(bag.readable_topics)} topics>"


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: rpud_sim.simulate(1, weight_on_bits=2), "did you mean weight_on_bit?"),
        (lambda: rpud_sim.simulate(1, weight_on_bit=-2), r"weight_on_bit = -2 N is outside"),
        (lambda: rpud_sim.simulate(0), "duration = 0 s is outside"),
        (lambda: rpud_sim.simulate(1, faults="jam"), "kind = 'jam'"),
        (lambda: rpud_sim.simulate(1, seed=-2), "seed = -2 is outside"),
        (lambda: rpud_sim.simulate(1e-12), "duration = 1e-12 s is outside"),
        (lambda: rpud_sim.simulate(1, faults=3), "faults = 3 is not a list"),
        (lambda: rpud_sim.simulate(1, faults=[3]), r"faults\[0\] = 3 is not a mapping"),
        (lambda: rpud_sim.simulate(1, config=3), "config = 3 is not the path of a file"),
        (lambda: rpud_sim.simulate(1, commands=[]), r"commands = \[\] is not the path of a file"),
        (lambda: rpud_sim.simulate(1).waveform(9, start=-1), "start = -1 s is outside"),
        (lambda: rpud_sim.simulate(1).waveform(9, 0, np.nan), "duration = nan s is outside"),
    ],
)
def test_what_cannot_be_used_is_one_line(call, text):
    with pytest.raises(rpud_sim.ParameterError, match=text) as error:
        call()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("section", ["/**", "drill_node", "/rpud/drill_node", "/*/drill_node"])
def test_a_parameter_file_is_read_as_by_the_commands(tmp_path, section):
    path = tmp_path / "robot.yaml"
    path.write_text(f"{section}: {{ros__parameters: {{seed: 7}}}}")
    assert rpud_sim.simulate(1, config=path).seed == 7


def test_without_extras_all_names_are_there_and_a_call_says_what_to_install(tmp_path):
    missing = ("matplotlib", "pandas", "scipy")
    program = f"""
import sys
sys.modules |= dict.fromkeys({missing})
from rpud_sim import *
run = simulate(1)
bags = [run.save(name) for name in ("one", "two")]
assert "needs matplotlib" in run._repr_html_()
for act in (run.plot, lambda: run.frame("wrench"), lambda: compare(bags)):
    try:
        act()
    except ModuleNotFoundError as error:
        print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [
        "a plot needs matplotlib: pip install 'rpud_sim[web]', or in a clone make setup",
        "a frame needs pandas: pip install pandas, or in a clone make setup",
        "a comparison needs scipy: pip install 'rpud_sim[web]', or in a clone make setup",
    ]


def test_unknown_topics_and_columns_name_the_nearest(run):
    with pytest.raises(KeyError, match="did you mean contact_force"):
        run["contact_forc"]
    rates = "actuator_impact_rate, drill_tool_impact_rate, squeezed_impact_rate"
    with pytest.raises(KeyError, match=f"^no metric 'impact_rate'; did you mean {rates}"):
        run.metrics["impact_rate"]
    with pytest.raises(KeyError, match="did you mean peak_force"):
        run["contact_force"]["peak_forces"]


def test_a_parameter_file_of_the_package_is_taken():
    run = rpud_sim.simulate(0.01, config=CONFIG / "tables_drilling.yaml", weight_on_bit=3.0)
    assert run.parameters["regime"] == "drilling"
    assert run.parameters["weight_on_bit"] == 3.0
    assert run.parameters["contact_model"] == "printed"
