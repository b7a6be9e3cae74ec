"""Messages in a hurry wait for subscribers before they would overwrite what those lack."""

from math import inf
from types import SimpleNamespace

import pytest

from rpud_sim.ros.outlets import Outlets


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
    outlets = Outlets(0.0)
    for name, depth in (("few", 4), ("many", 100), ("lost", inf)):
        outlets.add(name, publishers[name], depth)
    return outlets, publishers


def send(outlets, name, count, hurried=True):
    for _ in range(count):
        outlets.send(name, b"", hurried=hurried)


def test_a_hurry_waits_for_the_subscribers_of_all_topics_when_a_depth_is_used_up(made):
    outlets, publishers = made
    send(outlets, "many", 99)
    send(outlets, "few", 9)
    send(outlets, "many", 99)
    assert publishers["few"].asked == [4, 8]
    assert publishers["many"].asked == [99, 99]
    assert outlets.wait(0.0) == ["lost"]


def test_what_its_time_paces_leaves_half_of_the_depth_for_a_hurry(made):
    outlets, publishers = made
    send(outlets, "few", 50, hurried=False)
    assert publishers["few"].asked == []
    send(outlets, "few", 3)
    assert publishers["few"].asked == [52]


def test_where_a_message_may_be_overwritten_nothing_waits(made):
    outlets, publishers = made
    send(outlets, "lost", 1000)
    assert publishers["lost"].asked == []
