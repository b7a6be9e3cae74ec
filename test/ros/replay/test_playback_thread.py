"""The thread that plays has the priority that it is given, and what it starts has none."""

import os

import pytest
from support import real_time_permitted

from rpud_sim.bag import Message
from rpud_sim.ros.replay.playback import Plan, Playback, ReadAhead
from rpud_sim.ros.replay.replayer import PlaybackThread


def scheduled():
    return os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(0).sched_priority


class Outputs:
    def __init__(self):
        self.published = []

    def publish(self, message, *, hurried):
        self.published.append(scheduled())

    def publish_clock(self, bag_time):
        raise AssertionError("there is no clock")


@pytest.mark.parametrize("priority", [0, 7])
def test_it_publishes_with_its_priority(priority):
    outputs, readers = Outputs(), []

    def messages():
        readers.append(scheduled())
        yield Message("/a", 5, 5, b"")

    playback = Playback(lambda position: ReadAhead(messages()), Plan(5, 5), outputs)
    thread = PlaybackThread(playback, priority)
    thread.start()
    thread.join()
    real_time = priority and real_time_permitted()
    assert outputs.published == [(os.SCHED_FIFO, 7) if real_time else (os.SCHED_OTHER, 0)]
    assert readers == [(os.SCHED_OTHER, 0)]
