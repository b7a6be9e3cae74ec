"""Publishers wait for subscribers, requests connect to all, and gaps are counted exactly."""

import itertools
import re
from math import inf
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import PoseWithCovariance
from hypothesis import given
from hypothesis import strategies as st
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from rpud_sim.bag.metadata import INFINITE
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.ros.endpoints import AcknowledgedPublishers, SequenceGaps, is_satisfied, request_for
from rpud_sim.ros.graph import UnknownTypeError, members_of, message_class
from rpud_sim.ros.replay.replayer import replay_offer


class Publisher:
    """It notes after how many messages it was asked whether its subscribers have them."""

    def __init__(self, answers=True):
        self.sent, self.asked, self.answers = [], [], answers
        self.handle = SimpleNamespace(publish_raw=self.sent.append)

    def wait_for_all_acked(self, duration):
        self.asked.append(len(self.sent))
        return self.answers


@pytest.fixture
def made():
    publishers = {"few": Publisher(), "many": Publisher(), "lost": Publisher(answers=False)}
    sent = AcknowledgedPublishers(0.0)
    for name, depth in (("few", 4), ("many", 100), ("lost", inf)):
        sent.add(name, publishers[name], depth)
    return sent, publishers


def send(sent, name, count, hurried=True):
    for _ in range(count):
        sent.send(name, b"", hurried=hurried)


def test_a_hurry_waits_for_the_subscribers_of_all_topics_when_a_depth_is_used_up(made):
    sent, publishers = made
    send(sent, "many", 99)
    send(sent, "few", 9)
    send(sent, "many", 99)
    assert publishers["few"].asked == [4, 8]
    assert publishers["many"].asked == [99, 99]
    assert sent.wait(0.0) == ["lost"]


def test_what_its_time_paces_leaves_half_of_the_depth_for_a_hurry(made):
    sent, publishers = made
    send(sent, "few", 50, hurried=False)
    assert publishers["few"].asked == []
    send(sent, "few", 3)
    assert publishers["few"].asked == [52]


@pytest.mark.parametrize(("has_ended", "asked"), [(True, [1]), (False, [1, 1])])
def test_a_delivery_awaits_subscribers_that_run(has_ended, asked):
    publisher, looked = Publisher(answers=False), []

    def lost(name):
        looked.append(name)
        publisher.answers = True
        return has_ended

    sent = AcknowledgedPublishers(0.0, lost)
    sent.add("lost", publisher, 4)
    send(sent, "lost", 1)
    assert sent.deliver(60.0) == ({"lost": True} if has_ended else {})
    assert publisher.asked == asked
    assert looked == ["lost"]


def test_what_is_overwritten_before_subscribers_have_it_is_counted_by_topic(made):
    sent, publishers = made
    publishers["few"].answers = False
    send(sent, "few", 7)
    assert sent.overwritten == {("few", False): 3}
    publishers["few"].answers = True
    send(sent, "few", 5)
    assert sent.overwritten == {("few", False): 4}


def test_the_reason_is_that_of_the_wait_and_a_topic_of_an_ended_subscriber_is_awaited_again():
    publisher, ended = Publisher(answers=False), True

    def lost(_):
        publisher.answers = not ended  # those that run answer while they are awaited
        return ended

    sent = AcknowledgedPublishers(60.0, lost)
    sent.add("force", publisher, 4)
    send(sent, "force", 4)
    ended = False  # the middleware forgets it
    send(sent, "force", 4)
    assert sent.overwritten == {("force", True): 4}
    send(sent, "force", 4)
    assert sent.overwritten == {("force", True): 4}


SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=5)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ALL = (SENSOR, RELIABLE, LATCHED)


def test_a_request_is_as_strong_as_the_weakest_offer_and_connects_to_all():
    assert request_for([RELIABLE], 5).reliability == ReliabilityPolicy.RELIABLE
    assert request_for([LATCHED], 5).durability == DurabilityPolicy.TRANSIENT_LOCAL
    for offers in itertools.product(ALL, ALL):
        assert is_satisfied(request_for(offers, 5), offers)
    for offer, others in ((RELIABLE, [SENSOR]), (LATCHED, [RELIABLE, LATCHED])):
        assert not is_satisfied(request_for([offer], 5), others)


def test_of_different_offers_the_strongest_of_each_policy_is_replayed():
    recorded = [
        RecordedProfile(reliability="best_effort", deadline=10, lifespan=1),
        RecordedProfile(durability="transient_local", lifespan=INFINITE),
        RecordedProfile(liveliness="manual_by_topic", liveliness_lease_duration=3),
    ]
    offer = replay_offer(recorded)
    assert offer.reliability == ReliabilityPolicy.RELIABLE
    assert offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert offer.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC
    assert offer.deadline == Duration(nanoseconds=10)
    assert offer.lifespan == Duration(nanoseconds=INFINITE)
    assert offer.liveliness_lease_duration == Duration(nanoseconds=3)


@given(st.integers(1, 10**12), st.sets(st.integers(1, 200)))
def test_gaps_of_one_publisher_are_counted_exactly(first, lost):
    gaps = SequenceGaps(lambda: 1)
    arrived = [number for number in range(202) if number not in lost]
    for number in arrived:
        gaps.record(first + number)
    assert gaps.missing == len(lost)


@given(
    st.lists(st.integers(0, 2), max_size=200), st.tuples(*[st.integers(1, 10**6) for _ in range(3)])
)
def test_several_publishers_that_lose_nothing_have_no_gaps(order, firsts):
    # Sequences of different publishers do not touch each other here, as they hardly ever do.
    following = [first + place * 10**7 for place, first in enumerate(firsts)]
    gaps = SequenceGaps(lambda: 3)
    for publisher in order:
        gaps.record(following[publisher])
        following[publisher] += 1
    assert gaps.missing == 0


@given(st.lists(st.integers(1, 10**6), min_size=1))
def test_what_new_publishers_sent_before_they_were_heard_is_missing(firsts):
    gaps = SequenceGaps(lambda: 1)
    gaps.from_first = True
    for first in sorted({2 * first for first in firsts}, reverse=True):  # none continues another
        gaps.record(first)
    assert gaps.missing == sum(2 * first - 1 for first in set(firsts))


@pytest.mark.parametrize(
    "name", ["nowhere_msgs/msg/Thing", "std_msgs/msg/Thing", "std_msgs/String", "json/msg/JSON", ""]
)
def test_another_type_is_named(name):
    with pytest.raises(UnknownTypeError, match=name or "''"):
        message_class(name)


@pytest.mark.parametrize(
    ("name", "hint"),
    [("std_msgs/msg/Strin", "did you mean String?"), ("std_msg/msg/String", "no std_msg.msg in")],
)
def test_a_type_that_is_not_installed_is_said_in_words(name, hint):
    with pytest.raises(UnknownTypeError, match=re.escape(hint)) as error:
        message_class(name)
    assert "Error" not in str(error.value)


def test_a_member_that_no_message_of_ours_has_is_named():
    with pytest.raises(UnknownTypeError, match=r"double\[36\]"):
        members_of(PoseWithCovariance)
