"""The node of the recorder follows the graph, and counts what its queue refuses."""

import re
import time

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import Status
from std_msgs.msg import Int32
from support import until

from rpud_sim.bag import Message
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.record import recorder_node
from rpud_sim.ros.record.recorder import failure
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.ros.record.writing import WriteQueue

RELIABLE = QoSProfile(depth=100)
SENSOR = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture
def peer(nodes):
    nodes.append(rclpy.create_node("peer", namespace="/rpud"))
    return nodes[-1]


@pytest.fixture
def record(nodes):
    def start(topics=(), namespace="/rpud", capacity=1 << 20, **options):
        options = RecordOptions(out="bag", topics=topics, namespace=namespace, **options)
        nodes.append(Recorder(WriteQueue(capacity), options))
        return nodes[-1]

    return start


def discovered(recorder, count):
    """Wait until the recorder knows so many topics, and give it."""
    until(lambda: recorder.discover() or len(recorder.topics) == count)
    return recorder


def heard(*publishers, by=1):
    """Wait until each publisher has its subscriptions."""
    until(lambda: all(each.get_subscription_count() == by for each in publishers))


class Declarations:
    """What a bag is told of topics."""

    def add_topic(self, topic, definition):
        return topic, definition


def items(recorder):
    """Give all that is in the queue: messages, and declarations as pairs."""
    recorder.intake.close()
    queued = iter(lambda: recorder.intake.get(1.0), None)
    return [item if isinstance(item, Message) else item(Declarations()) for item in queued]


def take(recorder, count):
    """Take until the queue has had `count` items, and give them."""
    taken = []

    def condition():
        recorder.receive()
        recorder.finish()
        taken.extend(items(recorder))
        return len(taken) >= count

    until(condition)
    return taken


@pytest.mark.parametrize(
    ("topics", "namespace", "error"),
    [
        (["a b"], "/rpud", ParameterError),
        (["a//b"], "/rpud", ParameterError),
        ([""], "/a", ParameterError),
        ([], "/a b", NameValidationException),
    ],
)
def test_what_is_no_name_is_refused(record, topics, namespace, error):
    with pytest.raises(error):
        record(topics, namespace)


def test_a_publisher_that_offers_less_is_recorded_as_well(peer, record):
    strong = peer.create_publisher(Int32, "a", RELIABLE)
    recorder = discovered(record(), 1)
    heard(strong)
    strong.publish(Int32(data=1))
    strong.wait_for_all_acked()
    weak = peer.create_publisher(Int32, "a", SENSOR)

    until(lambda: recorder.discover() or weak.get_subscription_count() == 1)
    heard(strong)
    weak.publish(Int32(data=2))
    strong.publish(Int32(data=3))
    _, *taken = take(recorder, 4)
    assert sorted(message.data[4] for message in taken) == [1, 2, 3]


def test_a_name_that_never_appears_and_a_namespace_without_topics_are_failures(peer, record):
    publisher = peer.create_publisher(Int32, "contact_force", RELIABLE)
    named = record(["contact_forse"])
    until(
        lambda: (
            named.discover() or dict(named.get_topic_names_and_types()).get("/rpud/contact_force")
        )
    )
    named.finish()
    assert failure(named, allow_empty=False) == (
        "never appeared: /rpud/contact_forse; did you mean /rpud/contact_force?"
    )
    assert failure(named, allow_empty=True) == ""
    empty = record(namespace="/rpd")
    until(lambda: dict(empty.get_topic_names_and_types()).get("/rpud/contact_force"))
    empty.finish()
    assert failure(empty, allow_empty=False) == (
        "nothing came on 0 topics in /rpd; did you mean /rpud?"
    )
    there = record(["contact_force", "/elsewhere/d"])
    peer.create_publisher(Int32, "/elsewhere/d", RELIABLE)
    discovered(there, 2)
    assert there.complete
    assert failure(there, allow_empty=False) == "nothing came on 2 topics in /rpud"
    heard(publisher)
    publisher.publish(Int32(data=1))
    until(lambda: there.receive() and there.taken)
    assert failure(there, allow_empty=False) == ""


@pytest.mark.parametrize("of_drill", [True, False])
def test_log_times_are_of_the_drill_that_is_the_source_of_clock(peer, nodes, record, of_drill):
    if not of_drill:
        nodes.append(rclpy.create_node("other"))
    talking = peer.create_publisher(Status, "status", RELIABLE)
    ticking = nodes[-1].create_publisher(Clock, "/clock", RELIABLE)
    recorder = discovered(record(), 1)
    heard(talking, ticking)
    assert not recorder.clock.decided or of_drill
    talking.publish(Status())
    ticking.publish(Clock(clock=Time(sec=7)))

    def decided():
        recorder.discover()
        recorder.receive()
        return recorder.clock.decided and (not of_drill or recorder.clock._ticks)

    until(decided)
    assert recorder.clock.simulated == of_drill
    assert (recorder.clock.at(time.time_ns()) == 7_000_000_000) == of_drill


def test_a_recorder_of_everything_waits_for_the_clock_of_a_drill(peer, record, monkeypatch, capfd):
    recorder = record(everything=True)
    peer.get_logger().info("a line on /rosout")
    until(lambda: (recorder.discover(), recorder.receive(), recorder.taken)[-1])
    monkeypatch.setattr(recorder_node, "_UNDECIDED", 0.0)
    recorder.discover()
    assert not recorder.clock.decided
    monkeypatch.setattr(recorder_node, "_PATIENCE", 0.0)
    recorder.discover()
    assert recorder.clock.decided
    peer.create_publisher(Status, "status", RELIABLE)
    peer.create_publisher(Clock, "/clock", RELIABLE)
    until(lambda: (recorder.discover(), recorder._warned)[-1])
    assert not recorder.clock.simulated
    assert "log times stay in this machine's time, as /rpud/peer, which" in capfd.readouterr().err


@pytest.mark.extended
def test_after_a_standstill_what_is_silent_is_subscribed_again(peer, record):
    silent = peer.create_publisher(Int32, "silent", LATCHED)
    talking = peer.create_publisher(Int32, "talking", RELIABLE)
    recorder = discovered(record(), 2)
    heard(silent, talking)
    silent.publish(Int32(data=1))
    until(lambda: recorder.receive() and recorder.taken == 1)
    began = time.monotonic()
    until(lambda: time.monotonic() > began + 2.2)

    def renewed():
        talking.publish(Int32(data=2))
        recorder.receive()
        recorder.discover()
        return recorder.topics["/rpud/silent"].renewals

    until(renewed)
    assert not recorder.topics["/rpud/talking"].renewals
    heard(silent)
    silent.publish(Int32(data=3))

    def numbers():
        recorded = (item for item in items(recorder) if isinstance(item, Message))
        return [item.data[4] for item in recorded if item.topic == "/rpud/silent"]

    found = []
    until(lambda: recorder.receive() and (found.extend(numbers()) or 3 in found))
    assert found == [1, 3]  # what is latched came again, and is no new message
    assert recorder.losses["/rpud/silent"].total == 0


def test_all_topics_end_together(peer, record):
    publishers = [peer.create_publisher(Int32, name, RELIABLE) for name in ("a", "b")]
    recorder = discovered(record(), 2)
    heard(*publishers)
    publishers[0].publish(Int32(data=1))
    recorder.end()
    for publisher in (*publishers, *publishers):
        publisher.publish(Int32(data=2))
    assert all(publisher.wait_for_all_acked(Duration(seconds=30.0)) for publisher in publishers)
    until(lambda: recorder.receive() and recorder.taken)
    recorder.finish()
    (topic, _), message, (silent, _) = items(recorder)
    assert (topic.name, message.data[4:]) == ("/rpud/a", b"\1\0\0\0")
    assert silent.name == "/rpud/b"


NAMES = ("/rpud/status", "/rpud/deep/status", "/rpud/_hidden/status", "/other/clock", "/tf")


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        ({}, {"/rpud/status", "/rpud/deep/status"}),
        ({"topics": ["/tf"]}, {"/tf"}),
        ({"topics": ["/rpud/_hidden/status"]}, {"/rpud/_hidden/status"}),
        ({"regex": "status$"}, {"/rpud/status", "/rpud/deep/status"}),
        ({"regex": "clock", "topics": ["/tf"]}, {"/other/clock", "/tf"}),
        ({"everything": True}, {"/rpud/status", "/rpud/deep/status", "/other/clock", "/tf"}),
        ({"everything": True, "regex": "clock"}, set(NAMES) - {"/rpud/_hidden/status"}),
        ({"exclude": ["deep"]}, {"/rpud/status"}),
        ({"everything": True, "exclude": ["^/rpud"]}, {"/other/clock", "/tf"}),
        ({"topics": ["/tf", "/rpud/status"], "exclude": ["tf"]}, {"/rpud/status"}),
        ({"everything": True, "exclude": ["deep", "tf"]}, {"/rpud/status", "/other/clock"}),
    ],
)
def test_topics_are_chosen_by_name_expression_or_namespace(record, options, wanted):
    patterns = {"exclude": [*map(re.compile, options.get("exclude", ()))]}
    if "regex" in options:
        patterns["regex"] = re.compile(options["regex"])
    recorder = record(**(options | patterns), namespace="rpud")
    assert set(filter(recorder.wants, NAMES)) == wanted
    assert not recorder.complete


@pytest.mark.parametrize("options", [{}, {"regex": re.compile("status")}, {"everything": True}])
def test_a_hidden_namespace_that_is_named_is_recorded(record, options):
    recorder = record(**options, namespace="/_drill")
    assert recorder.wants("/_drill/status")
    assert not recorder.wants("/_drill/_hidden/status")
    assert not recorder.wants("/_other/status")


@pytest.mark.parametrize("waits", [False, True])
def test_first_messages_of_a_publisher_that_came_after_the_recorder_are_lost(
    peer, record, monkeypatch, waits
):
    monkeypatch.setattr(recorder_node, "DISCOVERY", 0.0 if waits else 60.0)
    recorder = record()
    publisher = peer.create_publisher(Int32, "a", RELIABLE)
    for number in range(3):
        publisher.publish(Int32(data=number))
    discovered(recorder, 1)
    heard(publisher)
    publisher.publish(Int32(data=4))
    until(lambda: recorder.receive() and recorder.taken)
    assert recorder.losses["/rpud/a"].total == (3 if waits else 0)
