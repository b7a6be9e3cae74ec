"""A listener hears a topic of any type, with the QoS of its publishers, or says why not."""

from contextlib import contextmanager

import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rpud_msgs.msg import Status
from std_msgs.msg import Int32, String
from support import PATIENCE

from rpud_sim.ros.client.listening_node import ClientError, ListeningNode
from rpud_sim.ros.client.topic_listener import TopicListener, types_of_topic

SENSOR = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=3, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@contextmanager
def participant():
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("talker", namespace="/heard", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def talker():
    with participant() as node:
        yield node


@pytest.fixture
def listening():
    with ListeningNode("listener", "/heard", patience=PATIENCE) as listening:
        yield listening


def first(listener):
    """Return the first messages that come."""
    return listener.take(PATIENCE)


def test_a_latched_topic_gives_its_last_messages(talker, listening):
    publisher = talker.create_publisher(String, "latched", LATCHED)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    listener = TopicListener(listening, "latched")
    assert listener.kind is String
    heard = first(listener)
    while len(heard) < 3:
        heard += first(listener)
    assert [each.data for each in heard] == ["2", "3", "4"]


def test_a_best_effort_publisher_that_comes_later_is_received_too(talker, listening):
    talker.create_publisher(Int32, "mixed", 10)
    listener = TopicListener(listening, "mixed")
    sensor = talker.create_publisher(Int32, "mixed", SENSOR)
    while not (heard := listener.take(0.2)):
        sensor.publish(Int32(data=7))
    assert heard[0].data == 7


def test_a_publisher_of_a_topic_that_only_had_a_subscription_is_received(talker, listening):
    talker.create_subscription(Status, "later", print, 10)
    listener = TopicListener(listening, "later")
    publisher = talker.create_publisher(Status, "later", LATCHED)
    publisher.publish(Status(state="running"))
    assert first(listener)[0].state == "running"


def test_a_topic_that_is_not_there_is_one_line_with_the_nearest_name(talker, listening):
    talker.create_publisher(String, "speech", 10)
    TopicListener(listening, "speech")
    with pytest.raises(ClientError) as error:
        TopicListener(listening, "speach", patience=0.1)
    assert str(error.value) == "no topic /heard/speach within 0.1 s; did you mean /heard/speech?"


def test_a_topic_of_two_types_is_refused(talker, listening):
    talker.create_publisher(String, "twofold", 10)
    with participant() as other:
        other.create_publisher(Int32, "twofold", 10)
        two = ["std_msgs/msg/Int32", "std_msgs/msg/String"]
        listening.wait_until(
            lambda: types_of_topic(listening.node, "/heard/twofold") == two, "not both"
        )
        with pytest.raises(ClientError, match=f"has several types: {', '.join(two)}"):
            TopicListener(listening, "twofold")


def test_messages_that_a_slow_listener_lost_are_counted(talker, listening):
    publisher = talker.create_publisher(Int32, "flood", SENSOR)
    listener = TopicListener(listening, "flood")
    while not listener.take(0.1):
        publisher.publish(Int32(data=-1))
    for number in range(6000):  # more than may wait
        publisher.publish(Int32(data=number))
    heard, sent = [], 6000
    while not (heard and heard[-1].data == sent - 1):  # best effort: the last may be lost too
        publisher.publish(Int32(data=sent))
        sent += 1
        heard += listener.take(0.2)
    assert listener.lost == sent - len([each for each in heard if each.data >= 0]) > 0
