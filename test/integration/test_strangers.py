"""Participants of the network that send what they should not: nothing of it ends a program."""

import re

import pytest
from drill_client import SECOND, nanoseconds
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import Status, WeightOnBit
from sample_bags import START, STRING, STRING_DEFINITION, STRING_HASH, serialized_string
from std_srvs.srv import Trigger

from rpud_sim.bag import BagWriter, QosProfile, Topic

FLOOD = 500


@pytest.fixture
def client(connect):
    return connect("/attacked")


@pytest.fixture
def clock(client):
    """Send times on /clock, those before zero too, for which rclpy raises an error."""
    publisher = client.node.create_publisher(Clock, "/clock", 1000)

    def send(seconds):
        client.until(publisher.get_subscription_count)
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)

    return send


def test_a_flood_of_malformed_commands_is_counted_in_full_and_logged_in_part(client, start_drill):
    drill = start_drill("/attacked")
    statuses = client.status
    client.until(lambda: statuses and statuses[-1].state == Status.STATE_RUNNING)
    client.command(WeightOnBit(force=11.0))
    [publisher] = [it for it in client.node.publishers if it.topic_name.endswith("weight_on_bit")]
    for _ in range(FLOOD):
        publisher.publish(serialize_message(WeightOnBit())[:12])
    client.command(WeightOnBit(force=12.0))
    client.until(lambda: statuses[-1].weight_on_bit == 12.0)
    client.until(lambda: statuses[-1].commands_rejected == FLOOD)
    assert statuses[-1].commands_accepted == 2
    assert 1 <= drill.output.count("is malformed") < FLOOD
    assert "deserialize" not in drill.output


def test_a_time_before_zero_on_the_clock_does_not_end_the_drill(client, clock, start_drill):
    drill = start_drill("/attacked", "waiting for /clock", use_sim_time=True)
    # Best effort: the first may come before the drill knows who sends it.
    client.until(lambda: clock(-1) or re.search("request refused: .*ValueError", drill.output))
    statuses = client.status
    clock(1000)
    client.until(lambda: statuses and statuses[-1].state == Status.STATE_RUNNING)
    assert nanoseconds(statuses[-1].drive_applied) == 1000 * SECOND
    clock(-5)
    request = GetState.Request()
    state = client.call(GetState, "drill_node/get_state", request).current_state
    assert state.id == State.PRIMARY_STATE_ACTIVE
    assert drill.running


def test_a_time_before_zero_on_the_clock_does_not_end_the_services_of_a_replay(
    process, client, clock, tmp_path
):
    with BagWriter(tmp_path / "bag") as writer:
        topic = Topic("/talk", STRING, STRING_HASH, (QosProfile(),))
        writer.add_topic(topic, STRING_DEFINITION)
        writer.write("/talk", serialized_string("hello"), START, START)
    replayer = process(
        *("replayer", tmp_path / "bag", "--start-paused"),
        *("--ros-args", "-p", "use_sim_time:=true"),
    )
    # Best effort: the first may come before the replayer knows who sends it.
    client.until(lambda: clock(-1) or "request failed: it raised ValueError" in replayer.output)
    assert client.call(Trigger, "/replayer/resume", Trigger.Request()).success
    assert replayer.wait() == 0
    replayer.wait_for_line(r"replayed 1 messages in .*, \d+ requests failed")
