"""A bag without ROS and a recording of the node have the same topics."""

import itertools
import time

import pytest

import rpud_sim.bag

pytestmark = pytest.mark.extended


def topics(path):
    """Return the topics that hold messages; the drill gets no commands here.

    The states of a node are not among them: offline there is no node.
    """
    with rpud_sim.bag.open(path) as bag:
        held = [summary for summary in bag.topics if summary.message_count]
        topics = {summary.topic: summary.definition for summary in held}
    return {topic: it for topic, it in topics.items() if "/drill_node/" not in topic.name}


def test_topics_are_those_of_a_recording(process, tmp_path):
    run = process("rpud", "run", "--duration", "2", "--record", tmp_path / "recorded")
    assert run.wait() == 0, run.output
    offline = process("rpud", "simulate", "--duration", "2", "--bag", tmp_path / "offline")
    assert offline.wait() == 0, offline.output
    assert topics(tmp_path / "offline") == topics(tmp_path / "recorded")


def test_a_replayed_one_is_recorded_whole(process, tmp_path):
    offline = process("rpud", "simulate", "--duration", "1", "--bag", tmp_path / "offline")
    assert offline.wait() == 0, offline.output
    recorder = process("rpud", "record", "--out", tmp_path / "again")
    recorder.wait_for_line(r"recording \d+ topics to")
    began = time.time_ns()
    replayer = process("rpud", "replay", tmp_path / "offline", "--wait-for-subscribers")
    assert replayer.wait() == 0, replayer.output
    recorder.interrupt()
    assert recorder.wait() == 0
    with (
        rpud_sim.bag.open(tmp_path / "offline") as first,
        rpud_sim.bag.open(tmp_path / "again") as again,
    ):
        for summary in first.topics:
            name = summary.topic.name
            sent = [message.data for message in first.messages([name])]
            heard = [message.data for message in again.messages([name])]
            assert len(heard) == len(sent), name
            # The middleware fills messages up to whole words.
            for first_data, again_data in zip(sent, heard, strict=True):
                assert again_data[: len(first_data)] == first_data, name
        times = [message.log_time for message in again.messages()]
    assert all(before <= after for before, after in itertools.pairwise(times))
    assert began < times[0] < times[-1] < time.time_ns()
