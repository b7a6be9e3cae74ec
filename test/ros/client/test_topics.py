"""Messages of any type as plain values, and fast ones without rclpy."""

from contextlib import contextmanager

import pytest
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovariance
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rpud_msgs.msg import Fault, Faults, Waveform
from sensor_msgs.msg import Image
from std_msgs.msg import Byte, ByteMultiArray, Header, Int32, String
from support import PATIENCE

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.client.listening_node import ClientError, ListeningNode
from rpud_sim.ros.client.topics import (
    field_getter,
    listen,
    to_plain,
)

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


class Listener:
    """Topic with its messages, which come while it waits."""

    def __init__(self, listening, name, **options):
        self._listening, self._messages = listening, []
        self.topic = listen(listening, name, self._messages, **options)

    def take(self, seconds=PATIENCE):
        self._listening.wait_until(lambda: self._messages, "a message", seconds)
        messages = self._messages.copy()
        self._messages.clear()
        return messages

    def wait_for(self, send):
        while not self._messages:
            send()
            self._listening.spin(0.1)
        return self.take()


def test_a_latched_topic_gives_its_last_messages(talker, listening):
    publisher = talker.create_publisher(String, "latched", LATCHED)
    for number in range(5):
        publisher.publish(String(data=str(number)))
    listener = Listener(listening, "latched")
    assert listener.topic.kind is String
    heard = listener.take()
    while len(heard) < 3:
        heard += listener.take()
    assert [each.data for each in heard] == ["2", "3", "4"]


def test_a_best_effort_publisher_that_comes_later_is_received_too(talker, listening):
    talker.create_publisher(Int32, "mixed", 10)
    listener = Listener(listening, "mixed")
    sensor = talker.create_publisher(Int32, "mixed", SENSOR)
    heard = listener.wait_for(lambda: sensor.publish(Int32(data=7)))
    assert heard[0].data == 7


def test_a_topic_that_is_not_there_is_one_line_with_the_nearest_name(talker, listening):
    talker.create_publisher(String, "speech", 10)
    listen(listening, "speech", [])
    with pytest.raises(ClientError) as error:
        listen(listening, "speach", [], patience=0.1)
    assert str(error.value) == "no topic /heard/speach within 0.1 s; did you mean /heard/speech?"


def test_messages_that_a_slow_listener_lost_are_counted(talker, listening):
    publisher = talker.create_publisher(Int32, "flood", SENSOR)
    listener = Listener(listening, "flood")
    listener.wait_for(lambda: publisher.publish(Int32(data=-1)))
    for number in range(6000):  # more than may wait
        publisher.publish(Int32(data=number))
    heard, sent = [], 6000
    while not (heard and heard[-1].data == sent - 1):  # best effort: the last may be lost too
        publisher.publish(Int32(data=sent))
        sent += 1
        heard += listener.take()
    assert listener.topic.lost == sent - len([each for each in heard if each.data >= 0]) > 0


FAULTS = Faults(
    header=Header(stamp=Time(sec=3)),
    faults=[Fault(kind="choking", magnitude=0.5), Fault(kind="noise", channel="wrench")],
)


def test_every_kind_of_field_becomes_plain():
    assert to_plain(FAULTS)["faults"][1]["channel"] == "wrench"
    assert to_plain(PoseWithCovariance())["covariance"] == [0.0] * 36
    assert to_plain(Byte(data=b"\x07")) == {"data": 7}
    assert to_plain(ByteMultiArray(data=[b"\x01", b"\xff"]))["data"] == [1, 255]
    assert to_plain(Image(data=b"\x00\x80"))["data"] == [0, 128]


def test_a_path_leads_through_messages_and_arrays():
    assert field_getter("header.stamp.sec", Faults)(FAULTS) == 3
    assert field_getter("faults[1].kind", Faults)(FAULTS) == "noise"
    assert field_getter("faults[2].kind", Faults)(FAULTS) is None
    bounded = field_getter("floating_point_range[0].step", ParameterDescriptor)
    assert bounded(ParameterDescriptor()) is None
    assert field_getter("covariance[35]", PoseWithCovariance)(PoseWithCovariance()) == 0.0


@pytest.mark.parametrize(
    ("path", "kind", "reason"),
    [
        ("fault", Faults, "field 'fault': there is no 'fault'; did you mean faults?"),
        ("header.stamp.secs", Faults, "did you mean sec?"),
        ("header.stamp.sec.x", Faults, "int32 has no fields"),
        ("header[0]", Faults, "std_msgs/Header is not an array"),
        ("faults[0].knd", Faults, "did you mean kind?"),
        ("faults[]", Faults, "is not a path such as"),
        ("", Waveform, "is not a path such as"),
    ],
)
def test_a_field_that_is_not_there_is_one_line(path, kind, reason):
    with pytest.raises(ParameterError, match=r"^field '.*$") as error:
        field_getter(path, kind)
    assert reason in str(error.value)
