"""A bag without ROS and a recording of the node have the same topics."""

import pytest

import rpud_sim.bag

pytestmark = pytest.mark.extended


def topics(path):
    """Return the topics that hold messages; the drill gets no commands here.

    What only a node publishes is not among them: its states, and results of commands.
    """
    with rpud_sim.bag.open(path) as bag:
        held = [summary for summary in bag.topics if summary.message_count]
        topics = {summary.topic: summary.definition for summary in held}
    of_node = ("/drill_node/", "/command_results")
    return {topic: it for topic, it in topics.items() if not any(w in topic.name for w in of_node)}


def test_topics_are_those_of_a_recording(process, tmp_path):
    run = process("rpud", "run", "--duration", "2", "--record", tmp_path / "recorded")
    assert run.wait() == 0, run.output
    offline = process("rpud", "simulate", "--duration", "2", "--bag", tmp_path / "offline")
    assert offline.wait() == 0, offline.output
    assert topics(tmp_path / "offline") == topics(tmp_path / "recorded")
