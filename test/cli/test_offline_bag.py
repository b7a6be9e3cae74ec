"""`rpud simulate --bag` writes the topics of the drill node without ROS."""

import itertools
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from support import called

import rpud_sim.bag
from rpud_sim.bag.manifest import MANIFEST_RECORD as MANIFEST
from rpud_sim.bag.manifest import manifest_from_record
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.simulation import preset
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.fields import SEGMENT_ARRAYS
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.sampling import Times
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
MAIN = f"""
import sys
sys.modules.update(dict.fromkeys({ROS}))  # importing any of them fails
from rpud_sim.cli.main import main
main()
"""


def simulate(*words):
    """Run `rpud simulate` where there is no ROS."""
    away = ("AMENT_PREFIX_PATH", "ROS_DISTRO", "ROS_DOMAIN_ID")
    return subprocess.run(
        [sys.executable, "-c", MAIN, "simulate", *map(str, words)],
        env={name: value for name, value in os.environ.items() if name not in away},
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("offline") / "bag"
    result = simulate("--duration", DURATION, "--bag", path)
    assert (result.returncode, result.stderr) == (0, "")
    return path


@pytest.fixture(scope="module")
def block():
    return Simulation(preset("drilling")).advance_to(END)


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
    names += " reacting_force status trajectory waveform wrench"
    assert sorted(messages) == [f"/rpud/{name}" for name in names.split()]
    for name, topic in messages.items():
        times = [time for time, _ in topic]
        assert times == sorted(times)
        # An impact is published when its contact is over, a stream when its block is.
        longest = {"contact_force": 0.001, "waveform": 0.05, "trajectory": 0.06}
        allowed = longest.get(name.removeprefix("/rpud/"), 0.0) * SECOND
        for time, stamp in zip(times, stamps(topic), strict=True):
            assert 0 <= time - stamp <= allowed, name


def test_the_bag_is_in_the_order_of_its_times(bag):
    with rpud_sim.bag.open(bag) as opened:
        times = [message.log_time for message in opened.messages()]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, END)


def test_contact_forces_are_those_of_the_simulation_without_a_gap(messages, block):
    found = messages["/rpud/contact_force"]
    assert column(found, "sequence") == list(range(len(block.impacts)))
    for name in ("peak_force", "contact_duration", "impact_velocity", "impulse", "energy"):
        assert column(found, name) == block.impacts[name].tolist()
    times = block.impacts["seconds"] + block.impacts["fraction"]
    assert np.array(stamps(found)) == pytest.approx(times * SECOND, abs=1.0)


def test_telemetry_is_the_trajectory_at_100_hz(messages, block):
    times = np.arange(1, 124) * (SECOND // 100)
    samples = block.sample(Times.from_nanoseconds(times))
    for name in ("nodal_plane", "drill_tool", "reacting_force", "wrench", "joint_states"):
        assert stamps(messages[f"/rpud/{name}"]) == times.tolist()
    planes, tools = messages["/rpud/nodal_plane"], messages["/rpud/drill_tool"]
    assert column(planes, "position") == samples.nodal_plane_position.tolist()
    assert column(planes, "velocity") == samples.nodal_plane_velocity.tolist()
    assert column(tools, "displacement") == samples.drill_tool_displacement.tolist()
    assert column(tools, "in_contact") == samples.in_contact.tolist()
    forces = column(messages["/rpud/reacting_force"], "force")
    assert forces == samples.reacting_force.tolist()
    assert [-m.wrench.force.z for _, m in messages["/rpud/wrench"]] == forces
    joints = messages["/rpud/joint_states"]
    bodies = (
        samples.nodal_plane_position,
        samples.free_mass_position,
        samples.drill_tool_displacement,
    )
    assert np.array_equal(column(joints, "position"), np.stack(bodies, axis=1))


def test_the_waveform_is_the_trajectory_at_50_khz_without_a_gap(messages, block):
    found = messages["/rpud/waveform"]
    samples = block.sample(Times.from_grid(0, round(DURATION * 50_000), 50_000))
    for name in ("actuator_position", "free_mass_position", "contact_force", "reacting_force"):
        assert np.array_equal(np.concatenate(column(found, name)), getattr(samples, name))
    lengths = [len(message.contact_force) for _, message in found]
    assert lengths[:-1] == [2500] * 24
    assert column(found, "sequence") == [0, *itertools.accumulate(lengths[:-1])]


def test_the_trajectory_is_the_segments_themselves(messages, block):
    found = messages["/rpud/trajectory"]
    for name in SEGMENT_ARRAYS:
        assert np.array_equal(np.concatenate(column(found, name)), block.segments[name])
    lengths = [len(message.duration) for _, message in found]
    assert column(found, "sequence") == [0, *itertools.accumulate(lengths[:-1])]


def test_status_comes_every_second_and_at_the_end(messages):
    found = messages["/rpud/status"]
    assert stamps(found) == [0, SECOND, END]
    assert column(found, "state") == ["running", "running", "stopped"]
    assert column(found, "regime") == ["drilling"] * 3
    assert column(found, "impacts")[-1] >= len(messages["/rpud/contact_force"])


def test_without_a_scenario_there_are_no_faults(messages):
    [(time, message)] = messages["/rpud/faults"]
    assert (time, len(message.faults), message.forgotten) == (0, 0, 0)


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


def test_rpud_info_knows_of_no_loss(capsys, bag):
    content = json.loads(called(capsys, "info", bag, "--json")[1])
    assert content["duration"] == END
    assert {topic["losses"] for topic in content["topics"]} == {0}


def test_the_same_seed_gives_the_same_bag(capsys, tmp_path):
    def written(name, seed):
        path = tmp_path / name
        words = ("--duration", 0.2, "--seed", seed, "--bag", path)
        assert called(capsys, "simulate", *words)[0] == 0
        with rpud_sim.bag.open(path) as bag:
            return list(bag.messages())

    first = written("first", 1)
    assert written("again", 1) == first
    assert written("other", 2) != first


def test_faults_of_a_scenario_are_in_the_bag_with_what_they_do(tmp_path):
    scenario = tmp_path / "faults.yaml"
    scenario.write_text(
        "faults:\n"
        "  - {kind: off, channel: nodal_plane, onset: 0.2, duration: 0.15}\n"
        "  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.1, duration: 0.105}\n"
        "  - {kind: delayed, channel: drill_tool, magnitude: 0.1, onset: 0.3}\n"
        "  - {kind: lost_preload, magnitude: 0.5, onset: 0.123456789}\n"
    )
    words = ["--set", f"scenario={scenario}", "--set", "rock_model=specific_energy"]
    path = tmp_path / "bag"
    result = simulate("--duration", 0.6, *words, "--seed", 5, "--bag", path)
    assert (result.returncode, result.stderr) == (0, "")
    with rpud_sim.bag.open(path) as bag:
        [manifest] = map(manifest_from_record, bag.records(MANIFEST))
    assert (manifest.seed, manifest.scenario) == (5, scenario.read_text())
    assert manifest.parameters["rock_model"] == "specific_energy"
    assert manifest.command[-2:] == ("--bag", str(path))
    assert manifest.versions.keys() >= {"rpud_sim", "python", "numpy", "numba"}
    found = {}
    with AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found.setdefault(connection.topic.removeprefix("/rpud/"), []).append((time, message))

    def nanoseconds(time):
        return time.sec * SECOND + time.nanosec

    times, ledgers = zip(*found["faults"], strict=True)
    # Three come and two go, each published at the end of its block.
    expected = [0.0, 0.1, 0.13, 0.2, 0.21, 0.3, 0.35]
    assert list(times) == [round(second * SECOND) for second in expected]
    last = {fault.kind: fault for fault in ledgers[-1].faults}
    assert nanoseconds(last["lost_preload"].onset) == 123_456_789
    assert nanoseconds(last["off"].clear) == 350_000_000
    assert [last[kind].active for kind in ("off", "bias", "delayed", "lost_preload")] == [
        False,
        False,
        True,
        True,
    ]
    silent = set(range(20, 35))
    planes = [stamp // 10_000_000 for stamp in stamps(found["nodal_plane"])]
    assert planes == sorted(set(range(1, 61)) - silent)
    for (_, wrench), (stamp, force) in zip(found["wrench"], found["reacting_force"], strict=True):
        biased = 100_000_000 <= stamp < 205_000_000
        assert wrench.wrench.force.z == -force.force + (100.0 if biased else 0.0)
    late = [
        time - stamp
        for (time, _), stamp in zip(found["drill_tool"], stamps(found["drill_tool"]), strict=True)
    ]
    assert late == [0] * 29 + [100_000_000] * 21
    assert found["status"][-1][1].active_faults == 2
    assert found["status"][-1][1].depth > 0.0


def test_a_bag_is_never_overwritten(capsys, tmp_path):
    line = f"rpud simulate: {tmp_path} exists already; a bag is never overwritten\n"
    assert called(capsys, "simulate", "--duration", 0.1, "--bag", tmp_path) == (1, "", line)


def test_an_interrupted_run_leaves_no_bag(tmp_path):
    def interrupt(seconds):
        raise KeyboardInterrupt

    beginning = Beginning(Settings(Configuration(preset("drilling"))))
    with pytest.raises(KeyboardInterrupt):
        write_offline_bag(tmp_path / "bag", beginning, 1.0, report=interrupt)
    assert not (tmp_path / "bag").exists()
