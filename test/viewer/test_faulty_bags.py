"""Frames of bags with garbage, lost messages or wrong stamps."""

import numpy as np
import pytest
from altered_bags import altered, numbered
from recorded_bags import SECOND, ForceRecorder, frame_of, header, rows_of
from sample_bags import write_offline_bag

from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import find_definition, find_type_hash, installed_codec
from rpud_sim.simulation import preset
from rpud_sim.viewer.frames import View

CONTACT, FAULTS = "rpud_msgs/msg/ContactForce", "rpud_msgs/msg/Faults"


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    path = tmp_path_factory.mktemp("faulty") / "healthy"
    write_offline_bag(path, preset("drilling"), 6.0)
    return path


WHOLE = View(None, 0.0, 99.0)


def test_one_garbage_impact_leaves_the_band_of_all_others(healthy, tmp_path):
    codec = installed_codec(CONTACT)

    def spoil(message):
        fields = to_plain(codec.decode(message.data))
        return [codec.encode({**fields, "peak_force": 5.622377492818663e174})]

    path = altered(healthy, tmp_path / "bag", numbered("contact_force", 700, spoil))
    layer = frame_of(path, view=WHOLE)["view"]["layers"]["peak_force"]
    assert np.nanmin(layer["low"]) > 10.0
    assert np.nanmax(layer["high"]) < 10e3
    assert len(layer["outliers"]["v"]) + layer["outliers"]["more"] < 200
    assert layer["garbage"]["count"] == 1
    peak = frame_of(path, playhead=layer["garbage"]["t"][0] + 0.3)["numbers"]["peak_force"]
    assert (peak["garbage"], 1e3 < peak["mean"] < 10e3) == (1, True)  # of all others


def test_lost_messages_are_not_shown_as_no_impacts(healthy, tmp_path):
    start = None

    def lose(message):
        nonlocal start
        start = message.log_time if start is None else start
        lost = 2 * SECOND < message.log_time - start < 4.5 * SECOND
        return [] if lost and message.topic == "/rpud/contact_force" else [message.data]

    path = altered(healthy, tmp_path / "bag", lose)
    layers = frame_of(path, view=WHOLE)["view"]["layers"]
    holes = layers["peak_force"]["holes"]
    assert holes[0][0] <= 2.1
    assert holes[-1][1] >= 3.9
    assert "holes" not in layers["reacting_force"]
    lost = frame_of(path, playhead=3.9)["numbers"]
    assert (lost["peak_force"]["mean"], lost["peak_force"]["lost"]) == (None, True)
    assert lost["impact_rate"]["mean"] > 100.0
    assert "lost" not in frame_of(path, playhead=1.9)["numbers"]["peak_force"]


def test_one_wrong_stamp_sets_no_length_and_no_drill_is_drawn(tmp_path):
    recorder = ForceRecorder(tmp_path / "bag")
    rows = rows_of(300)
    rows[150] = (rows[150][0], 351_608_008 * SECOND, 1.0)
    recorder.write(rows, "/sensor/force")
    recorder.close()
    frame = frame_of(tmp_path / "bag")
    assert frame["now"] == pytest.approx(2.99, abs=0.1)
    assert "1 of /sensor/force" in frame["notice"]
    assert not frame["moves"]


def test_first_messages_of_a_drill_are_no_complaint(tmp_path):
    """A latched message is older than the bag that begins with it."""
    codec, path = installed_codec(FAULTS), tmp_path / "bag"
    force = installed_codec("rpud_msgs/msg/ReactingForce")
    with BagWriter(path) as bag:
        for name, kind in (("faults", FAULTS), ("reacting_force", force.type)):
            offer = QosProfile(durability="transient_local" if kind == FAULTS else "volatile")
            topic = Topic(f"/rpud/{name}", kind, find_type_hash(kind), (offer,))
            bag.add_topic(topic, find_definition(kind))
        none = {"header": header(5 * SECOND), "faults": [], "forgotten": 0}
        bag.write("/rpud/faults", codec.encode(none), 0, 0)
        for log, stamp, value in rows_of(300, stamp=100 * SECOND):
            fields = {"header": header(stamp), "force": value, "impacts": 0}
            bag.write("/rpud/reacting_force", force.encode(fields), log, log)
    frame = frame_of(path)
    assert frame["now"] == pytest.approx(2.99, abs=0.1)
    assert "Stamps outside" not in frame["notice"]
