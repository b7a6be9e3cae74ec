"""Talker, recorder, replayer and listener are processes of their own, and talk over DDS."""

import itertools
import os
import signal
import sys
from pathlib import Path

import pytest
from drill_client import PLENTY
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.qos import QoSProfile as MiddlewareProfile
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rpud_msgs.msg import ContactForce, NodalPlane, Status
from std_msgs.msg import Header
from support import PATIENCE, until

import rpud_sim.bag

HELPERS = Path(__file__).parents[1] / "helpers"

CONTACT_FORCE = "/rpud/contact_force"
NODAL_PLANE = "/rpud/nodal_plane"
STATUS = "/rpud/status"


@pytest.fixture
def program(process):
    """Start one of the programs beside this file."""
    return lambda name, *words: process(sys.executable, HELPERS / f"{name}.py", *map(str, words))


def contents(path):
    """Give the messages of a bag as hexadecimal text, by topic."""
    with rpud_sim.bag.open(path) as bag:
        found = {summary.topic.name: [] for summary in bag.topics}
        for message in bag.messages():
            found[message.topic].append(message.data.hex())
    return found


def losses(path):
    with rpud_sim.bag.open(path) as bag:
        return {summary.topic.name: summary.losses.total for summary in bag.topics}


def numbers(messages):
    return [deserialize_message(bytes.fromhex(item), ContactForce).sequence for item in messages]


def missing(messages):
    """Give how many numbered messages lack between the first and the last."""
    positions = [deserialize_message(bytes.fromhex(item), NodalPlane).position for item in messages]
    return round(positions[-1] - positions[0]) + 1 - len(positions)


def finished(process):
    return process.wait() == 0


class Listener:
    """Messages of a talker as they come, in hexadecimal text by topic."""

    def __init__(self, client):
        self._client = client
        self.heard = {CONTACT_FORCE: [], NODAL_PLANE: [], STATUS: []}
        unsure = MiddlewareProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT)
        latched = MiddlewareProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        kinds = ((ContactForce, PLENTY), (NodalPlane, unsure), (Status, latched))
        for (name, heard), (kind, qos) in zip(self.heard.items(), kinds, strict=True):
            client.node.create_subscription(
                kind, name, lambda data, heard=heard: heard.append(data.hex()), qos, raw=True
            )

    def enough(self):
        """Wait for what the talker has published, and give it; some of the planes may be lost."""
        forces, planes, statuses = self.heard.values()
        self._client.until(lambda: len(forces) == 500 and len(planes) >= 400 and statuses)
        return self.heard


def test_published_messages_are_recorded_replayed_and_received(process, program, connect, tmp_path):
    listener = Listener(connect("/rpud"))
    named = ("contact_force", "status", NODAL_PLANE)
    recorder = process("recorder", *named, "--out", tmp_path / "run")
    recorder.wait_for_line(r"recording \d topics to .*run")
    talker = program("talker", "--count", 500, "--rate", 500, "--subscribers", 2)
    recorder.wait_for_line(r"subscribed /rpud/contact_force \[rpud_msgs/msg/ContactForce\]")
    talker.wait_for_line("published 500")
    recorder.interrupt()
    assert finished(recorder)
    recorder.wait_for_line(r"recorded \d+ messages on 3 topics")
    heard = listener.enough()
    recorded = contents(tmp_path / "run")
    assert numbers(recorded[CONTACT_FORCE]) == list(range(500))
    assert recorded[CONTACT_FORCE] == heard[CONTACT_FORCE]
    assert recorded[STATUS] == heard[STATUS]
    assert len(recorded[STATUS]) == 1
    assert losses(tmp_path / "run")[NODAL_PLANE] == missing(recorded[NODAL_PLANE])
    talker.terminate()
    talker.wait()

    with AnyReader([tmp_path / "run"]) as reader:
        by_topic = {connection.topic: connection for connection in reader.connections}
        types = {topic: connection.msgtype for topic, connection in by_topic.items()}
        offers = {topic: by_topic[topic].ext.offered_qos_profiles for topic in by_topic}
        connection, _, data = next(reader.messages([by_topic[CONTACT_FORCE]]))
        assert reader.deserialize(data, connection.msgtype).sequence == 0
        store = reader.typestore
        for topic, connection in by_topic.items():
            assert connection.digest == store.hash_rihs01(connection.msgtype), topic
    assert types[STATUS] == "rpud_msgs/msg/Status"
    assert [len(offer) for offer in offers.values()] == [1, 1, 1]
    assert offers[CONTACT_FORCE][0].reliability == QosReliability.RELIABLE
    assert offers[CONTACT_FORCE][0].durability == QosDurability.VOLATILE
    assert offers[NODAL_PLANE][0].reliability == QosReliability.BEST_EFFORT
    assert offers[STATUS][0].durability == QosDurability.TRANSIENT_LOCAL

    listener = Listener(connect("/rpud"))
    replayer = process("replayer", tmp_path / "run", "--wait-for-subscribers")
    assert finished(replayer)
    replayer.wait_for_line(rf"replayed {sum(map(len, recorded.values()))} messages")
    again = listener.enough()
    assert again[CONTACT_FORCE] == recorded[CONTACT_FORCE]
    assert again[STATUS] == recorded[STATUS]
    assert set(again[NODAL_PLANE]) <= set(recorded[NODAL_PLANE])


def test_what_is_lost_on_the_way_is_counted(process, connect, tmp_path):
    node = connect("/rpud").node
    recorder = process("recorder", "--out", tmp_path / "run")
    unsure = MiddlewareProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    planes = node.create_publisher(NodalPlane, "nodal_plane", unsure)
    forces = node.create_publisher(ContactForce, "contact_force", 1)
    numbers = itertools.count()
    # Long messages: the recorder stands still so shortly that its participant stays known.
    header = Header(frame_id="x" * 30_000)

    def publish(count):
        for number in itertools.islice(numbers, count):
            planes.publish(NodalPlane(header=header, position=float(number)))

    def publish_and_wait():
        """Publish one plane, and wait until the recorder has what was sent after it."""
        publish(1)
        forces.publish(ContactForce())
        assert forces.wait_for_all_acked(Duration(seconds=PATIENCE))

    until(lambda: all(each.get_subscription_count() for each in (planes, forces)))
    publish_and_wait()
    os.kill(recorder.pid, signal.SIGSTOP)
    publish(1000)  # far more than the middleware can hold for a recorder that stands still
    os.kill(recorder.pid, signal.SIGCONT)
    for _ in range(10):  # the recorder reads what was held; one that comes later shows the gap
        publish_and_wait()
    recorder.interrupt()
    assert finished(recorder)
    lost = missing(contents(tmp_path / "run")[NODAL_PLANE])
    assert lost > 0
    assert losses(tmp_path / "run")[NODAL_PLANE] == lost
    recorder.wait_for_line(rf"lost {lost} messages on /rpud/nodal_plane")


def test_a_type_that_is_not_installed_is_named_and_the_others_go_on(process, program, tmp_path):
    places = os.environ["PYTHONPATH"].split(os.pathsep)
    path = os.pathsep.join(place for place in places if "rpud_msgs" not in place)
    recorder = process(
        "recorder",
        "--namespace",
        "/",
        "--out",
        tmp_path / "run",
        env=os.environ | {"PYTHONPATH": path},
    )
    program("talker", "--count", 10)
    # Each publisher is discovered on its own.
    for topic, kind in (
        (STATUS, "Status"),
        (NODAL_PLANE, "NodalPlane"),
        (CONTACT_FORCE, "ContactForce"),
    ):
        recorder.wait_for_line(f"not recorded: {topic}: type rpud_msgs/msg/{kind} is not installed")
    recorder.wait_for_line(r"subscribed /rosout \[rcl_interfaces/msg/Log\]")
    recorder.interrupt()
    assert finished(recorder)
    recorder.wait_for_line("^not recorded: /rpud/status: ")
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert bag.records("rpud_skipped")[0].keys() == {CONTACT_FORCE, NODAL_PLANE, STATUS}
