"""The node of the replayer publishes what it can, and names what it cannot. Over real DDS."""

import dataclasses
from pathlib import Path

import pytest
import rclpy
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import ReactingForce
from sample_bags import CHAT, SECOND, START, TALK, serialized_string, write_bag
from support import until

import rpud_sim.bag
from rpud_sim.bag import Message, QosProfile, Topic
from rpud_sim.ros.graph import ClockSources
from rpud_sim.ros.replay.replayer import Replayer, last_latched

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def summaries(tmp_path):
    with rpud_sim.bag.open(write_bag(tmp_path / "run")) as bag:
        return {summary.topic.name: summary for summary in bag.topics}


@pytest.fixture
def replay():
    rclpy.init()
    nodes = []

    def start(*topics, with_clock=False, remap=()):
        nodes.append(Replayer(topics, with_clock=with_clock, remappings=remap))
        return nodes[-1]

    yield start
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def changed(summary, **changes):
    return dataclasses.replace(summary, topic=dataclasses.replace(summary.topic, **changes))


def test_it_offers_what_was_offered(replay, summaries):
    node = replay(*summaries.values())
    assert sorted(node.topics) == sorted([TALK.name, CHAT.name])
    assert sorted(node.topics.unsubscribed) == sorted(node.topics)
    [talk] = node.get_publishers_info_by_topic(TALK.name)
    assert talk.topic_type == TALK.type
    assert str(talk.topic_type_hash) == TALK.type_hash
    assert talk.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert talk.qos_profile.durability == DurabilityPolicy.VOLATILE
    [chat] = node.get_publishers_info_by_topic(CHAT.name)
    assert chat.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL


def test_a_second_source_of_the_clock_is_named_once(replay, capfd):
    node = replay(with_clock=True)
    sources = ClockSources(node)
    until(lambda: node.count_publishers("/clock") == 1)
    sources.look()
    other = rclpy.create_node("drill_node", namespace="/rpud")
    other.create_publisher(Clock, "/clock", 1)
    until(lambda: node.count_publishers("/clock") == 2)
    sources.look()
    sources.look()
    other.destroy_node()
    line = "/clock has 2 publishers, /rpud/drill_node and /rpud/replayer: time jumps between theirs"
    assert capfd.readouterr().err.count(line) == 1


def test_the_last_latched_messages_before_a_time_are_found(tmp_path):
    latched = QosProfile(durability="transient_local")
    topics = {
        "/one": (latched,),
        "/two": (latched, latched),  # of two publishers
        "/fast": (QosProfile(),),
    }
    with rpud_sim.bag.BagWriter(tmp_path / "bag") as writer:
        for name, offers in topics.items():
            writer.add_topic(Topic(name, TALK.type, TALK.type_hash, offers), None)
        for number in range(100):
            due = START + number * SECOND
            names = ["/fast", *(["/one"] if number == 20 else []), *(["/two"] * (number < 10))]
            for name in names:
                writer.write(name, bytes([0, 1, 0, 0, number]), due, due)
    with rpud_sim.bag.open(tmp_path / "bag") as bag:
        found = {
            end: [(m.topic, m.data[4]) for m in last_latched(bag, topics, end * SECOND)]
            for end in (0, 1, 5, 20, 21, 90)
        }
    assert found[0] == []
    assert found[1] == [("/two", 0)]
    assert found[5] == [("/two", 3), ("/two", 4)]
    assert found[20] == [("/two", 8), ("/two", 9)]
    assert found[21] == found[90] == [("/two", 8), ("/two", 9), ("/one", 20)]


@pytest.mark.parametrize(
    "changes",
    [
        {"type": "nowhere_msgs/msg/Thing"},
        {"type": ""},
        {"serialization_format": "json"},
        *({"name": name} for name in ("", "/a b", "1a", "/x//y")),
    ],
)
def test_what_cannot_be_published_is_left_out_and_named(replay, summaries, capfd, changes):
    node = replay(changed(summaries[TALK.name], **changes), summaries[CHAT.name])
    assert list(node.topics) == [CHAT.name]
    assert f"not replayed: {changes.get('name', TALK.name)}: " in capfd.readouterr().err


def test_a_topic_of_several_definitions_is_left_out_and_named(replay, summaries, capfd):
    kinds = frozenset({("cdr", TALK.type, "string data"), ("cdr", TALK.type, "int32 data")})
    node = replay(dataclasses.replace(summaries[TALK.name], kinds=kinds), summaries[CHAT.name])
    assert list(node.topics) == [CHAT.name]
    assert f"not replayed: {TALK.name}: it has several types" in capfd.readouterr().err


def test_there_is_one_clock(replay, summaries, capfd):
    node = replay(changed(summaries[TALK.name], name="/clock"), with_clock=True)
    assert list(node.topics) == []
    assert len(node.get_publishers_info_by_topic("/clock")) == 1
    assert "the bag's own /clock is replaced by --clock" in capfd.readouterr().err


@pytest.mark.parametrize("durability", ["volatile", "transient_local"])
@pytest.mark.parametrize("depth", [0, -1, 2**31, 2**70])
def test_any_depth_in_a_bag_is_offered_as_far_as_there_is_one(replay, summaries, depth, durability):
    offer = QosProfile(history="keep_last", depth=depth, durability=durability)
    node = replay(changed(summaries[TALK.name], offered_qos=(offer,)))
    assert list(node.topics) == [TALK.name]


def test_messages_of_an_earlier_release_arrive_with_what_they_have(replay):
    with rpud_sim.bag.open(DATA / "0.2.0" / "offline_free") as bag:
        [summary] = (each for each in bag.topics if each.topic.name == "/rpud/reacting_force")
        recorded = next(bag.messages({summary.topic.name}))
        expected = bag.arrays(summary.topic.name)["force"][0]
    node, subscriber = replay(summary), rclpy.create_node("subscriber")
    received = []
    subscriber.create_subscription(ReactingForce, summary.topic.name, received.append, 10)
    until(lambda: not node.topics.unsubscribed)

    def arrives():
        node.publish(recorded, hurried=True)
        rclpy.spin_once(subscriber, timeout_sec=0.1)
        return received

    until(arrives)
    subscriber.destroy_node()
    assert received[0].force == expected
    assert received[0].impacts == 0  # 0.2 has no such field


@pytest.mark.parametrize("data", [b"\x28\xb5\x2f\xfd....", b"\0\7\0\0....", b""])
def test_what_is_no_cdr_is_not_published_but_counted(replay, summaries, capfd, data):
    node = replay(summaries[TALK.name])
    for _ in range(2):
        assert not node.publish(Message(TALK.name, 5, 5, data), hurried=False)
    assert node.refused == {TALK.name: 2}
    said = capfd.readouterr().err
    assert said.count(f"messages of {TALK.name} are left out: it") == 1
    assert "not plain CDR" in said
    assert node.publish(Message(TALK.name, 5, 5, serialized_string("hi")), hurried=False)


def test_a_definition_without_a_hash_is_compared_with_the_installed_type(replay, summaries, capfd):
    talk = changed(summaries[TALK.name], type_hash="")
    node = replay(talk)
    assert node.publish(Message(TALK.name, 5, 5, serialized_string("hi")), hurried=False)
    replay(dataclasses.replace(talk, definition="string text"))
    said = f"not replayed: {TALK.name}: the installed std_msgs/msg/String has no text"
    assert said in capfd.readouterr().err


@pytest.mark.parametrize(
    ("definition", "data"),
    [("float64 data", bytes([0, 1, *bytes(10)])), ("int8[] data", serialized_string("hi")[:5])],
)
def test_what_does_not_fit_the_installed_type_is_left_out(
    replay, summaries, capfd, definition, data
):
    talk = changed(summaries[TALK.name], type_hash="another")
    node = replay(dataclasses.replace(talk, definition=definition))
    assert not node.publish(Message(TALK.name, 5, 5, data), hurried=False)
    assert node.refused == {TALK.name: 1}
    assert f"messages of {TALK.name} are left out: " in capfd.readouterr().err


def test_a_name_has_a_greatest_length_where_it_is_printed(replay, summaries, capfd):
    replay(changed(summaries[TALK.name], name="/" + "x y" * 5000, type="a/msg/B"))
    assert len(capfd.readouterr().err) < 600
