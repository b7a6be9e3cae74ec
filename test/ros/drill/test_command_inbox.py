"""Commands are taken in order, or refused with a reason; each is counted and has its result."""

import itertools
import math
import time
from types import SimpleNamespace

import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rpud_msgs.msg import Drive as DriveMessage
from rpud_msgs.msg import Feed as FeedMessage
from rpud_msgs.msg import MountMotion as MotionMessage
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support import PATIENCE

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill import commands
from rpud_sim.ros.drill.commands import (
    CommandTopics,
    Inbox,
    joints_to_feed,
    result_of,
)
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.commands import Drive, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS

SECOND = 1_000_000_000
NOW = 1000 * SECOND
ORIGIN = 990 * SECOND
NAN = math.nan
FEED, ROTATION = "rpud_feed", "rpud_rotation"
ARM = {"feed_model": "arm"}
CARRIED = {"feed_model": "given"}
TIMEOUT = {"command_timeout": 0.5}
GIVEN = result_of("weight_on_bit")


class Commander:
    """The topics of commands, and their publishers."""

    def __init__(self, drill, client):
        self.inbox = Inbox(drill.get_logger())
        self.settings = Settings()
        self.inbox.opened = True
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(drill)
        clock = (lambda: NOW, lambda: ORIGIN)
        CommandTopics(drill, self.inbox, lambda: self.settings, *clock)
        self.publishers = {}
        for topic, name in ALL_COMMAND_TOPICS.items():
            kind = message_class(name)
            self.publishers[kind] = client.create_publisher(kind, topic, 10)
        self.until(lambda: all(p.get_subscription_count() for p in self.publishers.values()))

    def until(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not (value := condition()):
            assert time.monotonic() < deadline, "it did not come true"
            self.executor.spin_once(timeout_sec=0.05)
        return value

    def give(self, message, kind=None):
        """Give a command, and give back what was taken of it, or why it was refused."""
        self.publishers[kind or type(message)].publish(message)
        rejected, taken = self.inbox.rejected, []

        def apply(command):
            self.settings.configuration.check(command)
            taken.append(command)

        self.until(lambda: self.inbox.drain(apply) or self.inbox.rejected > rejected)
        return taken[0] if taken else self.inbox.last_refusal


@pytest.fixture
def commander(nodes):
    nodes += [rclpy.create_node("drill_node"), rclpy.create_node("commander")]
    made = Commander(*nodes)
    yield made
    made.executor.shutdown()


def stamped(seconds):
    """Give a header whose stamp is so many seconds after now."""
    sec, nanosec = divmod(NOW + round(seconds * SECOND), SECOND)
    return Header(stamp=Time(sec=sec, nanosec=nanosec))


@pytest.mark.parametrize("order", itertools.permutations(range(3)))
def test_commands_that_wait_on_several_topics_act_in_the_order_of_their_arrival(commander, order):
    messages = [
        WeightOnBitMessage(force=20.0),
        DriveMessage(enabled=True, voltage=60.0, frequency=17000.0),
        MotionMessage(position=0.01),
    ]
    given = 2 * [messages[number] for number in order]
    for message in given:
        publisher = commander.publishers[type(message)]
        publisher.publish(message)
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE))
    found = []
    commander.until(lambda: commander.inbox.drain(found.append) and len(found) == len(given))
    kinds = {WeightOnBitMessage: WeightOnBit, DriveMessage: Drive, MotionMessage: MountMotion}
    assert [type(each) for each in found] == [kinds[type(each)] for each in given]


def test_each_topic_takes_its_commands(commander):
    assert commander.give(WeightOnBitMessage(force=20.0)) == WeightOnBit(20.0)
    drive = DriveMessage(enabled=True, voltage=60.0, frequency=17000.0)
    assert commander.give(drive) == Drive(True, 60.0, 17000.0)
    commander.settings = Settings().replace(ARM)
    assert commander.give(FeedMessage(mode=1, position=0.05)) == Feed("position", 0.05)
    assert commander.give(FeedMessage(mode=1, rate=NAN)) == Feed("position", 0.0)
    assert commander.give(FeedMessage(rate=1e-3, position=NAN)) == Feed("rate", 1e-3)
    # A command interface that no controller has claimed is no command, also of an idle drill.
    commander.publishers[JointState].publish(JointState(name=[FEED], velocity=[NAN]))
    assert commander.give(JointState(name=[FEED], velocity=[1e-3])) == Feed("rate", 1e-3)
    commander.settings = Settings().replace(CARRIED)
    assert commander.give(MotionMessage(position=0.01)) == MountMotion(0.01)
    # The stamp is the time of the sample, in simulation time.
    motion = MotionMessage(header=stamped(-0.25), position=0.01, velocity=1e-3)
    sampled = NOW - ORIGIN - SECOND // 4
    assert commander.give(motion) == MountMotion(0.01, 1e-3, sampled)
    assert (commander.inbox.accepted, commander.inbox.rejected) == (8, 0)


@pytest.mark.parametrize(
    ("topic", "values", "message", "reason"),
    [
        ("weight_on_bit", {}, WeightOnBitMessage(force=-1.0), "weight_on_bit = -1 N is outside"),
        ("weight_on_bit", {}, WeightOnBitMessage(force=NAN), "weight_on_bit = nan N is outside"),
        ("drive", {}, DriveMessage(enabled=True, voltage=1e4, frequency=16e3), "drive voltage ="),
        ("drive", {}, DriveMessage(enabled=True, voltage=100.0), "drive frequency = 0 Hz is out"),
        (
            "drive",
            {"nominal_voltage": 10.0, "vibration_amplitude": 35e-6},  # it would break the stack
            DriveMessage(enabled=True, voltage=500.0, frequency=16e3),
            "vibration_amplitude at drive voltage 500 V = 0.00175 m is outside its range [0,",
        ),
        ("feed", {}, FeedMessage(rate=1e-3), "a feed cannot be commanded with feed_model = none"),
        ("weight_on_bit", ARM, WeightOnBitMessage(force=2.0), "weight_on_bit cannot be commanded"),
        (
            *("feed", ARM, FeedMessage(position=0.01)),  # the mode was left out
            "feed mode = 0 (rate) takes no position, given 0.01 m: a position needs mode = 1",
        ),
        (
            *("feed", ARM, FeedMessage(mode=1, rate=1e-3, position=0.01)),
            "feed mode = 1 (position) takes no rate, given 0.001 m/s: a rate needs mode = 0",
        ),
        ("feed", ARM, FeedMessage(mode=2), "feed mode = 2 is not 0 (rate) or 1 (position)"),
        ("feed", ARM, FeedMessage(rate=6e-3), "feed rate = 0.006 m/s is outside its range"),
        (
            "feed",
            ARM,
            FeedMessage(mode=1, position=0.4),
            "feed position = 0.4 m is outside its range",
        ),
        ("feed", CARRIED, FeedMessage(), "a feed cannot be commanded with feed_model = given"),
        ("mount", ARM, MotionMessage(), "the motion of the mount cannot be commanded with feed_"),
        ("mount", CARRIED, MotionMessage(position=NAN), "mount position = nan m is outside"),
        ("mount", CARRIED, MotionMessage(position=0.4), "mount position = 0.4 m is outside"),
        ("mount", CARRIED, MotionMessage(velocity=1e-2), "mount velocity = 0.01 m/s is outside"),
        (
            "mount",
            CARRIED,  # also without a command_timeout
            MotionMessage(header=stamped(1.1)),
            "mount is stale: its stamp is 1.100 s ahead of the drill's time; allowed is 1 s",
        ),
        (
            "weight_on_bit",
            TIMEOUT,
            WeightOnBitMessage(header=stamped(-0.6)),
            "weight_on_bit is stale: its stamp is 0.600 s old; allowed is 0.5 s",
        ),
        (
            "drive",
            TIMEOUT,
            DriveMessage(header=stamped(0.6)),
            "drive is stale: its stamp is 0.600 s ahead of the drill's time; allowed is 0.5 s",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason(commander, topic, values, message, reason):
    commander.settings = Settings().replace(values)
    assert commander.give(message).startswith(reason)
    [result] = commander.inbox.take_results()[1]
    assert (result["kind"], result["accepted"]) == (topic, False)
    assert result["header"]["stamp"]["sec"] == message.header.stamp.sec


def test_a_long_frame_is_refused_and_not_kept(commander):
    message = WeightOnBitMessage(header=Header(frame_id=1000 * "long"))
    reason = "weight_on_bit: frame_id has 4000 characters; allowed are 256 at most"
    assert commander.give(message) == reason
    [result] = commander.inbox.take_results()[1]
    assert len(result["header"]["frame_id"]) == 256
    commander.inbox.refuse_request(10_000 * "why")
    assert len(commander.inbox.last_refusal) == 4096


@pytest.mark.parametrize("seconds", [-0.5, 0.0, 0.5, None])
def test_a_fresh_stamp_and_none_are_taken_and_any_without_a_timeout(commander, seconds):
    late = WeightOnBitMessage(header=stamped(-99.0))
    assert commander.give(late) == WeightOnBit(0.0)
    commander.settings = Settings().replace(TIMEOUT)
    header = Header() if seconds is None else stamped(seconds)
    assert commander.give(WeightOnBitMessage(header=header, force=2.0)) == WeightOnBit(2.0)


def test_a_closed_gate_refuses_everything(commander):
    commander.inbox.opened = False
    assert commander.give(WeightOnBitMessage()) == "weight_on_bit: the drill is not active"
    assert commander.give(DriveMessage()) == "drive: the drill is not active"


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (WeightOnBitMessage, b"\0\1\0\0"),
        (WeightOnBitMessage, serialize_message(WeightOnBitMessage())[:12]),
        (DriveMessage, b"\xff" * 4 + serialize_message(DriveMessage())[4:]),
        (DriveMessage, serialize_message(DriveMessage())[:12] + b"\xff" * 24),
    ],
)
def test_a_malformed_payload_is_refused_and_the_next_command_taken(commander, kind, payload):
    said = f": a payload of {len(payload)} bytes is malformed"
    assert commander.give(payload, kind).endswith(said)
    assert isinstance(commander.give(kind()), (WeightOnBit, Drive))


def test_each_command_to_a_stopped_drill_is_taken_refused_or_counted_as_discarded(commander):
    inbox, count = commander.inbox, 3000
    commander.give(WeightOnBitMessage(force=1.0))
    for number in range(count - 1):  # nobody spins the drill meanwhile
        force = -1.0 if number % 7 == 0 else 2.0
        commander.publishers[WeightOnBitMessage].publish(WeightOnBitMessage(force=force))

    def counted():
        inbox.drain(id)
        return inbox.accepted + inbox.rejected + inbox.discarded == count

    commander.until(counted)
    assert inbox.discarded > 0
    assert inbox.rejected > 0


@pytest.mark.parametrize(
    ("message", "feed"),
    [
        # As the hardware interface sends it: all joints, and a value for one of them.
        (JointState(name=[FEED, ROTATION], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED, ROTATION], position=[0.02]), Feed("position", 0.02)),
        (JointState(name=[FEED], position=[NAN], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=["elbow", FEED], velocity=[7.0, 1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED, ROTATION]), None),
        (JointState(name=["elbow"], position=[1.0]), None),
        (JointState(), None),
        (JointState(name=[ROTATION, FEED], velocity=[NAN]), "name it once, and first"),
        (JointState(name=[FEED], position=[0.0, 1.0]), "for 1 joints give rpud_feed no single"),
        (JointState(name=[FEED, FEED], velocity=[0.0, 0.0]), "name it once, and first"),
        (JointState(name=[FEED], position=[0.02], velocity=[1e-3]), "a position or a velocity"),
        (JointState(name=[FEED], effort=[5.0]), "takes no effort, given 5"),
        (JointState(name=[ROTATION], velocity=[5.0]), "rpud_rotation cannot be commanded"),
        (JointState(name=["rpud_tool_tip_joint"], effort=[5.0]), "cannot be commanded"),
        (JointState(name=[FEED], velocity=[math.inf]), "feed rate = inf m/s is outside its range"),
    ],
)
def test_a_command_to_joints_feeds_is_none_or_is_refused(message, feed):
    if not isinstance(feed, str):
        assert joints_to_feed(message) == feed
        return
    with pytest.raises(ParameterError) as refused:
        joints_to_feed(message)
    assert feed in str(refused.value)
    assert "\n" not in str(refused.value)


def test_commands_to_the_joints_of_another_drill_are_none_of_this_one():
    message = JointState(name=[FEED, f"left_{FEED}", f"right_{ROTATION}"], velocity=[1.0, 1e-3])
    assert joints_to_feed(message, "left_") == Feed("rate", 1e-3)
    assert joints_to_feed(message, "right_") is None
    with pytest.raises(ParameterError, match="left_rpud_rotation cannot be commanded; of the "):
        joints_to_feed(JointState(name=[f"left_{ROTATION}"], velocity=[1.0]), "left_")


class Log(list):
    warning = list.append


def test_refusals_are_counted_and_logged_and_of_a_flood_only_some(monkeypatch):
    log, woken = Log(), []
    monkeypatch.setattr(commands, "time", SimpleNamespace(monotonic=lambda: 5.9))
    inbox = Inbox(log, lambda: woken.append(True))
    inbox.refuse(GIVEN, "weight_on_bit = -1 N is outside its range [0, 1000] N")
    inbox.refuse_request("there is no fault 7 to clear")
    assert (inbox.accepted, inbox.rejected, inbox.requests_refused) == (0, 1, 1)
    assert inbox.last_refusal == "there is no fault 7 to clear"
    assert log == [
        "command rejected: weight_on_bit = -1 N is outside its range [0, 1000] N",
        "request rejected: there is no fault 7 to clear",
    ]
    for number in range(10_000):
        inbox.refuse(GIVEN, str(number))
    assert inbox.rejected == len(woken) == 10_001
    assert len(log) == 11
    assert log[-1] == "further rejections in this second are counted but not logged"


def test_each_result_is_told_once_after_the_last_ones_of_each_kind():
    inbox = Inbox(Log())
    assert inbox.take_results() is None  # a late subscriber gets results, and nothing empty
    first, second, third = (
        result_of("weight_on_bit", Header(frame_id=name)) for name in ("first", "second", "third")
    )
    inbox.accept(WeightOnBit(1.0), first)
    assert inbox.take_results() is None  # it waits
    inbox.drain(id)
    accepted = {**first, "accepted": True}
    assert inbox.take_results() == ([], [accepted])
    inbox.accept(WeightOnBit(2.0), second)
    inbox.refuse(result_of("drive"), "for a reason")
    inbox.drain(id)
    refused = {**result_of("drive"), "reason": "for a reason"}
    assert inbox.take_results() == ([accepted], [refused, {**second, "accepted": True}])
    inbox.accept(WeightOnBit(3.0), third)
    inbox.begin()  # what waits was meant for the run before
    repeated, [discarded] = inbox.take_results()
    assert (repeated, inbox.drain(id), discarded["accepted"]) == ([], False, False)
    assert (discarded["header"], inbox.discarded) == (third["header"], 1)
    assert "began again" in discarded["reason"]
    inbox.begin()
    assert inbox.take_results() is None
    assert (inbox.accepted, inbox.rejected) == (0, 0)
