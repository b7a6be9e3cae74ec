"""The gate takes what can be used while it is open, and says why it refuses the rest."""

import math
import time
from contextlib import suppress

import pytest
import rclpy
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rpud_msgs.msg import Drive as DriveMessage
from rpud_msgs.msg import Feed as FeedMessage
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support import PATIENCE

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.gate import Gate, arrival, to_feed
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings

SECOND = 1_000_000_000
NOW = 1000 * SECOND


class Heard(Inbox):
    """An inbox that remembers every reason; of a flood, it logs only the first ones."""

    def __init__(self, logger):
        super().__init__(logger)
        self.reasons = []

    def refuse(self, result, reason, **options):
        self.reasons.append(reason)
        super().refuse(result, reason, **options)


class Commander:
    """A gate, and a publisher of commands that waits until the gate has checked them."""

    def __init__(self, namespace="/"):
        self.drill = rclpy.create_node("drill_node", namespace=namespace)
        self.client = rclpy.create_node("commander", namespace=namespace)
        self.inbox = Heard(self.drill.get_logger())
        self.settings = Settings()
        self.gate = Gate(self.drill, lambda: self.settings, self.inbox, lambda: NOW)
        self.gate.open(True)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.drill)
        self.publishers = {
            kind: self.client.create_publisher(kind, topic, 10)
            for kind, topic in (
                (WeightOnBitMessage, "command/weight_on_bit"),
                (DriveMessage, "command/drive"),
                (FeedMessage, "command/feed"),
                (JointState, "joint_commands"),
            )
        }
        self.until(lambda: all(p.get_subscription_count() for p in self.publishers.values()))

    def until(self, condition):
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, "it did not come true"
            self.executor.spin_once(timeout_sec=0.05)

    def give(self, message):
        """Give a command, and give back what was taken of it, or why it was refused."""
        taken, refused = [], len(self.inbox.reasons)
        self.publishers[type(message)].publish(message)
        self.until(
            lambda: taken.extend(self.inbox.drain()) or taken or self.inbox.reasons[refused:]
        )
        return taken[0] if taken else self.inbox.reasons[-1]

    def close(self):
        self.executor.shutdown()
        self.drill.destroy_node()
        self.client.destroy_node()


@pytest.fixture(scope="module")
def shared():
    rclpy.init()
    commander = Commander()
    yield commander
    commander.close()
    rclpy.try_shutdown()


@pytest.fixture
def commander(shared):
    shared.settings = Settings()
    shared.gate.open(True)
    return shared


def stamped(seconds):
    """Give a header whose stamp is so many seconds after now."""
    sec, nanosec = divmod(NOW + round(seconds * SECOND), SECOND)
    return Header(stamp=Time(sec=sec, nanosec=nanosec))


def test_a_message_without_a_time_of_arrival_has_not_waited():
    before = time.monotonic_ns()
    assert arrival({"received_timestamp": 0}) >= before


def test_commands_that_can_be_used_are_taken(commander):
    assert commander.give(WeightOnBitMessage(force=20.0)) == WeightOnBit(20.0)
    drive = DriveMessage(enabled=True, voltage=60.0, frequency=17000.0)
    assert commander.give(drive) == Drive(True, 60.0, 17000.0)
    assert commander.give(DriveMessage()) == Drive(False, 0.0, 0.0)


ARM = {"feed_model": "arm"}


@pytest.mark.parametrize(
    ("values", "message", "reason"),
    [
        ({}, WeightOnBitMessage(force=-1.0), "weight_on_bit = -1 N is outside its range [0, 1000]"),
        ({}, WeightOnBitMessage(force=math.nan), "weight_on_bit = nan N is outside its range"),
        (
            {},
            DriveMessage(enabled=True, voltage=math.inf, frequency=16e3),
            "drive voltage = inf V is outside its range [0, 1000] V",
        ),
        (
            {},
            DriveMessage(enabled=True, voltage=100.0),
            "drive frequency = 0 Hz is outside its range [100, 200000] Hz",
        ),
        (
            {"nominal_voltage": 10.0, "vibration_amplitude": 35e-6},  # it would break the stack
            DriveMessage(enabled=True, voltage=500.0, frequency=16e3),
            "vibration_amplitude at drive voltage 500 V = 0.00175 m is outside its range [0,",
        ),
        ({}, FeedMessage(value=1e-3), "a feed cannot be commanded with feed_model = none"),
        (
            {},
            JointState(name=["rpud_feed"], velocity=[1e-3]),
            "a feed cannot be commanded with feed_model = none",
        ),
        (
            ARM,
            WeightOnBitMessage(force=20.0),
            "weight_on_bit cannot be commanded with feed_model = arm: it follows from the feed",
        ),
        (ARM, FeedMessage(mode=2), "feed mode = 2 is not 0 (rate) or 1 (position)"),
        (ARM, FeedMessage(value=math.nan), "feed rate = nan m/s is outside its range"),
        (
            ARM,
            FeedMessage(value=6e-3),
            "feed rate = 0.006 m/s is outside its range [-0.005, 0.005]",
        ),
        (
            ARM,
            FeedMessage(mode=1, value=0.4),
            "feed position = 0.4 m is outside its range [-0.1, 0.3]",
        ),
        (
            ARM,
            JointState(name=["rpud_feed"], velocity=[math.inf]),
            "feed rate = inf m/s is outside its range",
        ),
        (
            ARM | {"command_timeout": 0.5},
            JointState(header=stamped(-0.6), name=["rpud_feed"], velocity=[0.0]),
            "joint_commands is stale: its stamp is 0.600 s old",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_with_the_reason_and_counted(
    commander, values, message, reason
):
    commander.settings = Settings().replace(values)
    before = commander.inbox.rejected
    assert commander.give(message).startswith(reason)
    assert commander.inbox.rejected == before + 1


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (WeightOnBitMessage, b"\0\1\0\0"),
        (WeightOnBitMessage, serialize_message(WeightOnBitMessage())[:12]),
        (DriveMessage, b"\xff" * 4 + serialize_message(DriveMessage())[4:]),
        (DriveMessage, serialize_message(DriveMessage())[:12] + b"\xff" * 24),
    ],
)
def test_a_malformed_payload_is_refused_and_counted_and_the_next_command_taken(
    commander, kind, payload
):
    before = commander.inbox.rejected
    commander.publishers[kind].publish(payload)
    commander.until(lambda: commander.inbox.rejected == before + 1)
    assert commander.inbox.last_refusal.endswith(
        f": a payload of {len(payload)} bytes is malformed"
    )
    assert isinstance(commander.give(kind()), (WeightOnBit, Drive))


def test_each_command_to_a_stopped_drill_is_taken_refused_or_counted_as_discarded(shared):
    commander = Commander("/stopped")
    inbox, count = commander.inbox, 3000
    try:
        commander.give(WeightOnBitMessage(force=1.0))
        publisher = commander.publishers[WeightOnBitMessage]
        for number in range(count - 1):  # nobody spins the drill meanwhile
            publisher.publish(WeightOnBitMessage(force=-1.0 if number % 7 == 0 else 2.0))

        def counted():
            inbox.drain()
            return inbox.accepted + inbox.rejected + inbox.discarded == count

        commander.until(counted)
        assert inbox.discarded > 0
        assert inbox.rejected > 0
    finally:
        commander.close()


def test_all_commands_that_wait_are_taken_in_one_turn(shared):
    commander = Commander("/stream")
    try:
        publisher = commander.publishers[WeightOnBitMessage]
        for _ in range(10):
            publisher.publish(WeightOnBitMessage(force=2.0))
        publisher.wait_for_all_acked()
        commander.executor.spin_once(timeout_sec=30.0)
        assert len(commander.inbox.drain()) == 10
    finally:
        commander.close()


@pytest.fixture
def on_an_arm(commander):
    commander.settings = Settings().replace(ARM)
    return commander


def test_a_feed_is_taken_on_an_arm(on_an_arm):
    message = FeedMessage(mode=FeedMessage.MODE_RATE, value=-1e-3)
    assert on_an_arm.give(message) == Feed("rate", -1e-3)
    message = FeedMessage(mode=FeedMessage.MODE_POSITION, value=0.05)
    assert on_an_arm.give(message) == Feed("position", 0.05)


def test_a_command_interface_that_no_controller_has_claimed_is_no_command(on_an_arm):
    before = on_an_arm.inbox.rejected
    unclaimed = JointState(name=["rpud_feed", "rpud_rotation"], velocity=[math.nan])
    on_an_arm.publishers[JointState].publish(unclaimed)
    # The next one on the same topic comes after it.
    next_one = JointState(name=["rpud_feed"], velocity=[0.0])
    assert on_an_arm.give(next_one) == Feed("rate", 0.0)
    assert on_an_arm.inbox.rejected == before


@pytest.mark.parametrize("message", [WeightOnBitMessage(force=20.0), DriveMessage()])
def test_a_closed_gate_refuses_everything(commander, message):
    commander.gate.open(False)
    assert commander.give(message).endswith(": the drill is not active")
    commander.gate.open(True)
    assert isinstance(commander.give(message), (WeightOnBit, Drive))


@pytest.mark.parametrize("seconds", [-0.5, -0.1, 0.0, 0.5])
def test_a_fresh_stamp_and_none_are_taken(commander, seconds):
    commander.settings = Settings().replace({"command_timeout": 0.5})
    for header in (stamped(seconds), Header()):
        taken = commander.give(WeightOnBitMessage(header=header, force=20.0))
        assert taken == WeightOnBit(20.0)


@pytest.mark.parametrize(
    ("seconds", "what"),
    [(-0.6, "0.600 s old"), (0.6, "0.600 s ahead of the drill's time"), (-999.0, "999.000 s old")],
)
def test_a_stale_stamp_is_refused_where_there_is_a_timeout(commander, seconds, what):
    message = WeightOnBitMessage(header=stamped(seconds), force=20.0)
    assert commander.give(message) == WeightOnBit(20.0)
    commander.settings = Settings().replace({"command_timeout": 0.5})
    assert commander.give(message) == (
        f"weight on bit is stale: its stamp is {what}; allowed is 0.5 s"
    )
    drive = DriveMessage(header=stamped(seconds))
    assert commander.give(drive).startswith(f"drive is stale: its stamp is {what}")


def test_the_delay_of_a_command_begins_when_the_middleware_has_it(shared):
    shared.inbox.take_delays()
    shared.publishers[WeightOnBitMessage].publish(WeightOnBitMessage(force=12.0))
    sent = time.monotonic_ns()
    taken = []
    shared.until(lambda: taken.extend(shared.inbox.drain()) or taken)
    waited = (time.monotonic_ns() - sent) / SECOND
    assert 0.0 < shared.inbox.take_delays().greatest <= waited + 0.01


def test_the_time_of_day_may_be_set_while_a_command_waits():
    for jump in (-100 * SECOND, 100 * SECOND):
        arrived = arrival({"received_timestamp": time.time_ns() + jump})
        assert time.monotonic_ns() - SECOND - SECOND // 2 <= arrived <= time.monotonic_ns()


NAN = math.nan
FEED, ROTATION = "rpud_feed", "rpud_rotation"


@pytest.mark.parametrize(
    ("message", "feed"),
    [
        # As the hardware interface sends it: all joints, and a value for one of them.
        (JointState(name=[FEED, ROTATION], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED, ROTATION], position=[0.02]), Feed("position", 0.02)),
        (JointState(name=[FEED], position=[NAN], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=["elbow", FEED], velocity=[7.0, 1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED], velocity=[NAN]), None),
        (JointState(name=[FEED, ROTATION]), None),
        (JointState(name=["elbow"], position=[1.0]), None),
        (JointState(), None),
    ],
)
def test_a_command_feeds_or_is_none(message, feed):
    assert to_feed(message) == feed


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            JointState(name=[ROTATION, FEED], velocity=[1e-3]),
            "joint_commands: velocity has length 1 for 2 joints, of which rpud_feed is number 2: "
            "name it first",
        ),
        (JointState(name=[FEED], position=[0.0, 1.0]), "position has length 2 for 1 joints"),
        (JointState(name=[FEED, FEED], velocity=[0.0, 0.0]), "rpud_feed is named twice"),
        (
            JointState(name=[FEED], position=[0.02], velocity=[1e-3]),
            "takes a position or a velocity, given 0.02 m and 0.001 m/s",
        ),
        (JointState(name=[FEED], effort=[5.0]), "takes no effort, given 5"),
        (JointState(name=[ROTATION], velocity=[5.0]), "rpud_rotation cannot be commanded"),
        (JointState(name=["rpud_tool_tip_joint"], effort=[5.0]), "cannot be commanded"),
        (JointState(name=[FEED], velocity=[math.inf]), "feed rate = inf m/s is outside its range"),
        (JointState(name=[FEED], position=[2.0]), "feed position = 2 m is outside its range"),
    ],
)
def test_a_command_is_refused_with_its_reason_in_one_line(message, reason):
    with pytest.raises(ParameterError) as refused:
        to_feed(message)
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


NAMES = st.lists(st.sampled_from([FEED, ROTATION, "elbow", "rpud_nodal_plane_joint"]), max_size=4)
VALUES = st.lists(st.floats(), max_size=5)


@given(NAMES, VALUES, VALUES, VALUES)
def test_any_message_feeds_is_none_or_is_refused(names, position, velocity, effort):
    message = JointState(name=names, position=position, velocity=velocity, effort=effort)
    with suppress(ParameterError):
        feed = to_feed(message)
        assert feed is None or feed.value in [*position, *velocity]
