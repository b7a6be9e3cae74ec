"""What the recorder does beside recording, with real processes over DDS."""

import re
import shlex
import sys
from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rpud_msgs.msg import ContactForce
from rpud_msgs.srv import IsPaused
from std_srvs.srv import Trigger

import rpud_sim.bag
from rpud_sim.bag.own_records import MANIFEST_RECORD as MANIFEST
from rpud_sim.bag.own_records import manifest_from_record

HELPERS = Path(__file__).parents[1] / "helpers"
CONTACT_FORCE = "/rpud/contact_force"
STATUS = "/rpud/status"


@pytest.fixture
def talker(process):
    """Start the talker; it begins as soon as its three topics are heard."""
    return lambda *words: process(sys.executable, HELPERS / "talker.py", *map(str, words))


def manifests(path):
    with rpud_sim.bag.open(path) as bag:
        return [manifest_from_record(record) for record in bag.records(MANIFEST)]


def test_a_bag_holds_what_it_is_a_recording_of(process, tmp_path):
    scenario = tmp_path / "faults.yaml"
    scenario.write_text("faults:\n  - {kind: lost_preload, onset: 100.0}\n")
    settings = {"seed": 7.0, "gravity": 3.71, "regime": "drilling", "scenario": str(scenario)}
    words = [word for item in settings.items() for word in ("-p", "{}:={}".format(*item))]
    process("drill_node", "--ros-args", "-r", "__ns:=/rpud", *words)
    recorder = process("recorder", "contact_force", "--out", tmp_path / "run")
    recorder.wait_for_line("knows the parameters of /rpud/drill_node")
    recorder.interrupt()
    assert recorder.wait() == 0
    mistyped = process("recorder", "contact_froce", "--out", tmp_path / "none" / "bag")
    named = "/rpud/contact_froce; did you mean /rpud/contact_force?"
    mistyped.wait_for_line(re.escape(f"not there yet: {named}"))
    mistyped.interrupt()
    assert mistyped.wait() == 1
    assert f"never appeared: {named}: no bag is left" in mistyped.output
    assert not (tmp_path / "none").exists()
    [manifest] = manifests(tmp_path / "run")
    assert manifest.node == "/rpud/drill_node"
    assert {name: manifest.parameters[name] for name in settings} == settings
    assert manifest.parameters["drive_enabled"] is True
    assert manifest.seed == 7
    assert manifest.scenario is None  # the journal has it, with what was drawn
    assert shlex.join(manifest.command).endswith(f"contact_force --out {tmp_path / 'run'}")
    assert manifest.versions.keys() >= {"rpud_sim", "python", "numpy", "numba", "ros_distro"}


def test_answers_that_no_drill_gives_end_no_recording(process, talker, tmp_path):
    recorder = process("recorder", "--out", tmp_path / "run")
    process(sys.executable, HELPERS / "stranger.py").wait_for_line("answered")
    recorder.wait_for_line("an answer of /rpud/stranger cannot be used: ")
    talker("--count", 100, "--rate", 500).wait_for_line("published 100")
    recorder.interrupt()
    assert recorder.wait() == 0
    assert re.search(r"\d things that arrived could not be used", recorder.output)
    assert sequences(tmp_path / "run") == list(range(100))


def sequences(path):
    with rpud_sim.bag.open(path) as bag:
        return [
            deserialize_message(message.data, ContactForce).sequence
            for message in bag.messages([CONTACT_FORCE])
        ]


def test_services_pause_go_on_and_split(process, talker, connect, tmp_path):
    client = connect("/rpud")

    def ask(name):
        kind = IsPaused if name == "is_paused" else Trigger
        return client.call(kind, f"recorder/{name}", kind.Request())

    recorder = process("recorder", "--out", tmp_path / "run", "--start-paused")
    talker("--count", 100_000, "--rate", 500).wait_for_line("talking")
    assert ask("is_paused").paused
    ask("resume")
    assert not ask("is_paused").paused
    impacts = client.listen("contact_force")
    client.until(lambda: len(impacts) > 100)
    ask("split_bagfile")
    ask("pause")
    ask("toggle_paused")
    ask("toggle_paused")
    recorder.interrupt()
    assert recorder.wait() == 0
    said = re.findall(r": (paused|resumed|continues in a new file)", recorder.output)
    assert said == ["resumed", "continues in a new file", "paused", "resumed", "paused"]
    recorded = sequences(tmp_path / "run")
    assert recorded[0] > 0
    assert recorded == sorted(set(recorded))
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        statuses = [summary for summary in bag.topics if summary.topic.name == STATUS]
        assert [summary.message_count for summary in statuses] == [1]  # said once, in the pause
        assert all(summary.losses.total == 0 for summary in statuses)


def test_a_recorder_stops_before_its_bag_is_too_large(process, talker, tmp_path):
    limit = 200_000
    words = ("--max-disk", limit, "--compression", "none")
    recorder = process("recorder", "--out", tmp_path / "run", *map(str, words))
    talker("--count", 100_000, "--rate", 2000)
    assert recorder.wait() == 1
    assert recorder.output.splitlines()[-1] == (
        f"rpud record: stopped with a whole bag: it has reached --max-disk {limit} bytes"
    )
    assert sum(file.stat().st_size for file in (tmp_path / "run").iterdir()) <= limit
    recorded = sequences(tmp_path / "run")
    assert recorded == list(range(len(recorded)))
    assert len(recorded) > 100


def test_a_split_recording_has_every_message_and_its_losses(process, talker, tmp_path):
    words = ("--max-bag-duration", "0.2", "--max-bag-size", "200000", "--compression", "none")
    recorder = process("recorder", "--out", tmp_path / "run", *words)
    talker("--count", 1000, "--rate", 1000).wait_for_line("published 1000")
    recorder.interrupt()
    assert recorder.wait() == 0
    assert re.search(r"MB in \d+ files\)", recorder.output)
    assert len(list((tmp_path / "run").glob("*.mcap"))) >= 5
    assert sequences(tmp_path / "run") == list(range(1000))
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        losses = {summary.topic.name: summary.losses for summary in bag.topics}
        assert losses[CONTACT_FORCE].total == 0
        assert bag.compression == "none"
    with AnyReader([tmp_path / "run"]) as reader:
        assert reader.message_count >= 2001 - losses["/rpud/nodal_plane"].total
