"""Frames of a bag: overview, every message, the exact waveform, and the moment of the playhead."""

import itertools
import urllib.request

import numpy as np
import pandas as pd
import pytest
from altered_bags import altered
from frame_reader import decode
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_bags import DURATION, frame_of
from support import examples

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.recorded.rebuild import rebuild
from rpud_sim.viewer.frames import ClientState, View, encode
from rpud_sim.viewer.recorded import WAVEFORM, RecordedStore

RATE = 1_000_000
DRILL = "/rpud"


@pytest.fixture(scope="module")
def store(drill_bag):
    with RecordedStore(drill_bag) as opened:
        opened.read_all()
        yield opened


@pytest.fixture(scope="module")
def waveforms(store):
    return store.histories[DRILL].waveforms


@pytest.fixture(scope="module")
def rebuilt(drill_bag, tmp_path_factory):
    """Return all samples that `rpud export --rate` writes, and the number of the first."""
    folder = tmp_path_factory.mktemp("rebuilt") / "out"
    first = rebuild(drill_bag, folder, RATE).first
    table = pd.read_parquet(folder / "rpud.trajectory.parquet")
    names = ("contact_force", "free_mass_position", "reacting_force", "actuator_velocity")
    return first, {name: table[name].to_numpy() for name in names}


@pytest.fixture(scope="module")
def impacts(drill_bag):
    with rpud_sim.bag.open(drill_bag) as reader:
        return reader.arrays("/rpud/contact_force")


def asked(store, **state):
    """Return the first frame of a browser, as it comes there."""
    client = ClientState(**state)
    store.open(client)
    return decode(encode(store.frame(client)))


def viewed(store, start, end, width=800):
    return asked(store, view=View(None, start, end, width))["view"]


@given(st.floats(0.0, DURATION - 0.1), st.floats(2e-6, 0.03))
@settings(max_examples=examples(25))
@pytest.mark.extended
def test_samples_of_any_range_are_those_of_rebuild_bit_for_bit(waveforms, rebuilt, start, length):
    first, channels = rebuilt
    (stretch,) = waveforms.between(start, start + length, RATE)
    begin, end = int(np.ceil(start * RATE)), int(np.floor((start + length) * RATE)) + 1
    assert stretch.times.tolist() == [number / RATE for number in range(begin, end)]
    for name, values in channels.items():
        expected = values[begin - first : end - first]
        assert stretch.channels[name].tobytes() == expected.tobytes(), name


@pytest.mark.parametrize("number", [3, 36, 150])  # number 36 begins under force
def test_a_contact_shows_its_peak(store, impacts, number):
    time = impacts["header.stamp"][number] / 1e9
    duration = impacts["contact_duration"][number]
    view = viewed(store, time - 0.2 * duration, time + 1.2 * duration)
    assert view["detail"] == WAVEFORM
    force = view["layers"]["contact_force"]
    # Another contact may begin within the range.
    inside = (force["t"] >= time) & (force["t"] <= time + duration)
    assert inside.sum() > 200
    times, values = force["t"][inside], force["mean"][inside]
    peak = np.nanmax(values)
    # One that begins under force has its peak at once, in a pixel that shows the contact before it.
    pixel = 1.4 * duration / 800
    fall = (values[0] - values[9]) / (times[9] - times[0]) if peak == values[0] else 0.0
    assert peak == pytest.approx(impacts["peak_force"][number], rel=1e-5, abs=pixel * fall)
    assert {"nodal_plane", "actuator", "free_mass", "drill_tool"} <= view["layers"].keys()


def test_the_impact_after_and_before_a_time_are_found(store, impacts):
    times = impacts["header.stamp"] / 1e9
    client = ClientState()
    store.open(client)

    def jump(to, since):
        store.request(client, "seek", {"to": to, "from": since})
        return store.frame(client)["jump"]

    for number in (1, 17, len(times) - 1):
        assert jump("previous", times[number])["time"] == times[number - 1]
        found = jump("next", times[number - 1])
        assert found["time"] == times[number]
        assert found["peak_force"] == impacts["peak_force"][number]
        assert found["contact_duration"] == impacts["contact_duration"][number]
    assert jump("next", times[-1]) == {"none": "there is no further impact"}
    assert jump("previous", times[0]) == {"none": "there is no earlier impact"}


def test_a_long_range_is_drawn_from_the_overview(drill_bag, impacts, monkeypatch):
    monkeypatch.setattr("rpud_sim.viewer.recorded.MESSAGES_RANGE", 1.0)
    monkeypatch.setattr("rpud_sim.viewer.recording.SAMPLED", 5)
    with RecordedStore(drill_bag) as store:
        frame = asked(store)
        assert frame["view"]["detail"] == "overview"
        assert frame["read"] < 1.0
        # Five of forty parts give a first picture of the whole time.
        sketch = frame["view"]["layers"]["peak_force"]
        assert np.isfinite(sketch["mean"]).all()
        assert (sketch["t"][0] < 0.3 * DURATION, sketch["t"][-1] > 0.7 * DURATION) == (True, True)
        store.read_all()
        frame = asked(store)
    view = frame["view"]
    assert (view["start"], frame["read"]) == (0.0, 1.0)
    layer = view["layers"]["peak_force"]
    peaks = impacts["peak_force"]
    valid = np.isfinite(layer["mean"])
    assert (layer["low"][valid] <= layer["high"][valid]).all()
    assert layer["band"] == "5-95 %"
    assert 0.9 * peaks.max() < layer["high"][valid].max() <= 1.0001 * peaks.max()
    assert np.nanmax(frame["timeline"]["high"]) == pytest.approx(peaks.max())


def test_the_moment_of_the_playhead_has_figures_status_and_motion(store, impacts):
    time = 1.2
    frame = asked(store, playhead=time)
    assert frame["now"] == pytest.approx(DURATION, abs=0.01)
    times = impacts["header.stamp"] / 1e9
    inside = (times >= time - 1.0) & (times <= time)
    numbers = frame["numbers"]
    assert numbers["impact_rate"]["mean"] == pytest.approx(inside.sum())
    peaks = impacts["peak_force"][inside]
    assert numbers["peak_force"]["mean"] == pytest.approx(peaks.mean())
    assert numbers["peak_force"]["greatest"] == pytest.approx(peaks.max())
    assert len(numbers["peak_force"]["spark"]) <= 60
    assert numbers["penetration_rate"] is None  # this drill has no rock
    assert frame["status"]["regime"] == "drilling"
    assert frame["status"]["weight_on_bit"] == 8.0
    assert frame["values"]["reacting_force"].keys() == {"force", "impacts"}
    section = frame["section"]
    last = section["time"] + section["period"] * (len(section["free_mass"]) - 1)
    assert last == pytest.approx(time, abs=1e-4)
    assert len(section["free_mass"]) <= 1201
    within = times[(times >= section["time"]) & (times <= time)]
    assert [each[0] + section["time"] for each in section["impacts"]] == pytest.approx(
        within.tolist()
    )


def test_only_what_changed_is_sent(store):
    client = ClientState(view=View(None, 0.0, 1.0), playhead=0.5)
    store.open(client)
    store.frame(client)
    client.section = False
    assert store.frame(client) is None
    client.playhead = 0.6
    assert store.frame(client).keys() == {"status", "values", "numbers"}
    client.view = View(None, 0.0, 0.5)
    assert store.frame(client).keys() == {"view", "steps"}


def test_a_lost_block_is_a_gap_in_the_waveform(drill_bag, tmp_path):
    numbers = itertools.count()
    path = altered(
        drill_bag,
        tmp_path / "bag",
        lambda m: [] if m.topic == "/rpud/trajectory" and next(numbers) == 4 else [m.data],
    )
    with RecordedStore(path) as store:
        before, after = store.histories[DRILL].waveforms.between(0.1, 0.4, 100_000)
        assert after.times[0] - before.times[-1] > 0.04  # a block has 50 ms
        assert np.isnan(viewed(store, 0.16, 0.21)["layers"]["contact_force"]["mean"]).sum() <= 1
        begin = after.times[0]  # of the first segment after the loss
        assert 0.2 < begin < 0.2501
        section = store.histories[DRILL].section(begin + 0.01)
        assert len(section["free_mass"]) == pytest.approx(600, abs=5)
        assert section["time"] == pytest.approx(begin, abs=1e-4)


def test_commands_and_faults_are_told_in_words(store):
    frame = asked(store)
    assert [(each["time"], each["kind"], each["text"]) for each in frame["log"]] == [
        (0.0, "run", "a run begins"),
        (0.4, "fault", "fault 1: bias on reacting force 5 N begins"),
        (pytest.approx(0.7), "fault", "fault 1 ends"),
        (1.0, "fault", "fault 2: restitution loss 0.5 begins"),
        (DURATION, "run", "the drill stops"),
    ]
    assert [(each["onset"], each["end"], each["active"]) for each in frame["faults"]] == [
        (0.4, pytest.approx(0.7), False),
        (1.0, None, True),
    ]
    assert frame["steps"]["weight_on_bit"]["v"].tolist() == [8.0]


def test_what_a_bag_cannot_do_is_refused(store):
    with pytest.raises(ExpectedError, match="no drill in '/other'"):
        store.open(ClientState("/other"))
    with pytest.raises(ParameterError, match="no commands"):
        store.request(ClientState(DRILL), "act", {"name": "press", "arguments": {}})


def test_it_prints_where_the_page_is_and_ends_at_a_signal(process, drill_bag):
    server = process("rpud", "watch", drill_bag, "--port", "0")
    url = server.wait_for_line(r"bag .*: (http://127\.0\.0\.1:\d+/screen)$")[1]
    server.terminate()
    assert server.wait() == 0
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url)


def test_impacts_whose_type_has_no_peak_force_are_signals_as_others(tmp_path):
    kind, name = "rpud_msgs/msg/ContactForce", "/rpud/contact_force"
    codec = Codec(kind, "float64 duration\n")
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic(name, kind), "float64 duration\n")
        for number in range(3):
            bag.write(name, codec.encode({"duration": 1e-4}), number * 10**7, number * 10**7)
    assert frame_of(tmp_path / "bag")["values"] == {"contact_force": {"duration": 1e-4}}


def test_a_foreign_bag_shows_its_signals(tmp_path):
    kind, name = "geometry_msgs/msg/Vector3", "/robot/wrist"
    codec = Codec(kind, find_definition(kind))
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic(name, kind, find_type_hash(kind)), find_definition(kind))
        for number in range(300):
            data = codec.encode({"x": float(number), "y": 1.0, "z": 2.0})
            bag.write(name, data, number * 10**7, number * 10**7)
    frame = frame_of(tmp_path / "bag")
    assert (frame["drills"], frame["drill"]) == (["/robot"], "/robot")
    assert len(frame["plots"]) == 3
    shown = frame["plots"][0]["choices"][0]["layers"][0]["quantity"]
    assert shown == "/robot/wrist x"
    assert shown in {each["name"] for each in frame["quantities"]}
    layer = frame["view"]["layers"][shown]
    assert (layer["t"][-1], layer["mean"][-1]) == (pytest.approx(2.99), 299.0)
    assert frame["values"] == {"wrist": {"x": 299.0, "y": 1.0, "z": 2.0}}
    assert frame["numbers"]["impact_rate"] is None
