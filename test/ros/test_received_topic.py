"""A message with a time or a payload that cannot be is damaged, and counted once."""

import itertools
import time

import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int32

from rpud_sim.ros.endpoints import SequenceGaps
from rpud_sim.ros.received import ReceivedTopic, is_damaged

NOW = time.time_ns()
DAY = 86_400_000_000_000
DATA = b"\x00\x01\x00\x00\x05\x00\x00\x00"


@pytest.fixture
def topic(nodes):
    nodes.append(rclpy.create_node("recorder"))
    received = []
    topic = ReceivedTopic(nodes[0], "/rpud/a", Int32, lambda *message: received.append(message))
    topic.request = QoSProfile(depth=1)
    topic.gaps = SequenceGaps(lambda: 1)
    topic.messages = received
    return topic


def info(number, sent=NOW, received=NOW):
    return {
        "publication_sequence_number": number,
        "source_timestamp": sent,
        "received_timestamp": received,
    }


@pytest.mark.parametrize(
    ("data", "log_time", "publish_time"),
    [
        (b"", NOW, NOW),
        (DATA[:3], NOW, NOW),
        (DATA, 77, NOW),
        (DATA, 2**63 - 1, NOW),
        (DATA, NOW, 2**63),
        (DATA, NOW, -1),
    ],
    ids=itertools.count(),
)
def test_what_cannot_be_a_message_is_damaged(data, log_time, publish_time):
    assert is_damaged(data, log_time, publish_time)
    assert not is_damaged(DATA, NOW, NOW)
    assert not is_damaged(DATA[:4], NOW + DAY // 2, NOW)


@pytest.mark.parametrize("sent", [0, 77, NOW - 9000 * DAY, NOW + 2 * DAY], ids=itertools.count())
def test_a_message_of_a_publisher_whose_clock_is_off_is_kept(topic, sent):
    topic.receive(DATA, info(1, sent=sent))
    assert topic.messages == [(DATA, sent, NOW)]
    assert (topic.lost, topic.damaged) == (0, 0)


def test_a_damaged_message_is_no_gap_as_well(topic):
    topic.receive(DATA, info(1))
    topic.receive(b"", info(0))
    topic.receive(DATA, info(3, sent=-1))
    assert len(topic.messages) == 1
    topic.receive(DATA, info(6))
    assert (topic.damaged, topic.lost, len(topic.messages)) == (2, 2, 2)
    topic.receive(DATA, info(8))
    assert topic.lost == 3


def test_a_latched_message_that_comes_again_is_not_received_again(topic):
    topic.request = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    topic.receive(DATA, info(1))
    topic.receive(DATA, info(1))
    assert len(topic.messages) == 1
    topic.receive(DATA, info(1, sent=NOW + 1))
    assert len(topic.messages) == 2
