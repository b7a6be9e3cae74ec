"""`rpud simulate --bag` writes the topics of the drill node without ROS."""

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation

DURATION = 1.234  # no whole number of blocks
END = round(DURATION * SECOND)
ROS = (
    "ament_index_python",
    "rclpy",
    "rpud_msgs",
    "std_msgs",
    "geometry_msgs",
    "builtin_interfaces",
)


@pytest.fixture(scope="module")
def bag(lacking, tmp_path_factory):
    path = tmp_path_factory.mktemp("offline") / "bag"
    result = lacking(ROS, "simulate", "--duration", DURATION, "--bag", path)
    assert (result.returncode, result.stderr) == (0, "")
    return path


@pytest.fixture(scope="module")
def messages(bag):
    """All messages as rosbags reads them, with their log times, by topic."""
    found = {}
    with AnyReader([bag]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((time, message))
    return found


def stamps(messages):
    return [m.header.stamp.sec * SECOND + m.header.stamp.nanosec for _, m in messages]


def column(messages, name):
    return [getattr(message, name) for _, message in messages]


def test_every_topic_is_there_and_stamped_with_simulation_time(messages):
    names = "actuator_state contact_force drill_tool faults joint_states journal nodal_plane"
    names += " power reacting_force status trajectory waveform wrench"
    assert sorted(messages) == [f"/rpud/{name}" for name in names.split()]
    for name, topic in messages.items():
        times = [time for time, _ in topic]
        assert times == sorted(times)
        # An impact is published when its contact is over, a stream when its block is.
        longest = {"contact_force": 0.001, "waveform": 0.05, "trajectory": 0.06}
        allowed = longest.get(name.removeprefix("/rpud/"), 0.0) * SECOND
        for time, stamp in zip(times, stamps(topic), strict=True):
            assert 0 <= time - stamp <= allowed, name


def test_contact_forces_are_those_of_the_simulation_without_a_gap(messages):
    found, block = messages["/rpud/contact_force"], Simulation(preset("drilling")).advance_to(END)
    assert column(found, "sequence") == list(range(len(block.impacts)))
    for name in ("peak_force", "contact_duration", "impact_velocity", "impulse", "energy"):
        assert column(found, name) == block.impacts[name].tolist()
    times = block.impacts["seconds"] + block.impacts["fraction"]
    assert np.array(stamps(found)) == pytest.approx(times * SECOND, abs=1.0)


def test_mcap_ros2_support_reads_the_same(bag, messages):
    found = {}
    with (bag / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, record, message in reader.iter_decoded_messages():
            assert record.log_time == record.publish_time
            found.setdefault(channel.topic, []).append((record.log_time, message))
    assert {t: stamps(m) for t, m in found.items()} == {t: stamps(m) for t, m in messages.items()}
    topic = "/rpud/contact_force"
    assert column(found[topic], "peak_force") == column(messages[topic], "peak_force")
