"""A replay is controlled by services, in a process of its own, and heard over DDS."""

import itertools

import pytest
import rclpy
from builtin_interfaces.msg import Time
from drill_client import Client, nanoseconds
from raw_mcap import RawMcap
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from rpud_msgs.srv import Seek, SetRate
from sample_bags import SECOND, START, STRING, STRING_DEFINITION, STRING_HASH, serialized_string
from std_msgs.msg import String
from std_srvs.srv import Trigger
from support import until

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag import QosProfile as RecordedProfile

REPLAYED = "/rpud/talk"
SERVICES = {"seek": Seek, "set_rate": SetRate}
STEP = SECOND // 20  # between two messages


@pytest.fixture
def bag(tmp_path):
    """A bag of 40 numbered messages, 50 ms apart, and one on another topic."""
    with BagWriter(tmp_path / "bag") as writer:
        for name in (REPLAYED, "/rpud/chat"):
            writer.add_topic(
                Topic(name, STRING, STRING_HASH, (RecordedProfile(),)), STRING_DEFINITION
            )
        writer.write("/rpud/chat", serialized_string("hello"), START, START)
        for number in range(40):
            due = START + number * STEP
            writer.write(REPLAYED, serialized_string(str(number)), due, due)
    return tmp_path / "bag"


class Audience(Client):
    """Hears numbers and /clock, and calls the services of a replay."""

    def __init__(self):
        super().__init__()
        self.numbers = []
        self.clocks = []
        self.hear(REPLAYED, lambda message: self.numbers.append(int(message.data)))
        self.node.create_subscription(
            Clock,
            "/clock",
            lambda message: self.clocks.append(nanoseconds(message.clock) - START),
            QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT),
        )

    def hear(self, topic, callback):
        self.node.create_subscription(String, topic, callback, QoSProfile(depth=1000))

    def ask(self, service, **fields):
        kind = SERVICES.get(service, Trigger)
        return self.call(kind, f"/rpud/replayer/{service}", kind.Request(**fields))


@pytest.fixture
def audience():
    with Audience() as audience:
        yield audience


@pytest.fixture
def replay(process, bag):
    patient = ("--topics", REPLAYED, "--wait-for-subscribers")
    return lambda *words: process("replayer", bag, *patient, *words)


def at(position):
    """Give a time of the bag as a message [ns from its beginning]."""
    seconds, rest = divmod(START + position, SECOND)
    return Time(sec=seconds, nanosec=rest)


def test_a_replay_is_stepped_moved_sped_up_looped_and_stopped(replay, audience):
    process = replay("--start-paused", "--loop", "--clock", "100")
    audience.until(lambda: len(audience.clocks) > 5)
    assert set(audience.clocks) == {0}
    for _ in range(8):
        assert audience.ask("play_next").success
    audience.until(lambda: audience.numbers == list(range(8)))
    audience.until(lambda: audience.clocks[-3:] == [7 * STEP] * 3)
    assert audience.ask("seek", time=at(30 * STEP)).success
    audience.until(lambda: audience.clocks[-3:] == [30 * STEP] * 3)
    assert audience.ask("set_rate", rate=4.0).success
    before = len(audience.clocks)
    audience.ask("resume")
    audience.until(lambda: len(audience.numbers) > 8 + 10 + 40)
    audience.ask("pause")
    audience.ask("resume")
    # What follows a loop's last message is its first; nothing is left out.
    pairs = set(itertools.pairwise(audience.numbers))
    assert pairs <= {(7, 30), *((number, (number + 1) % 40) for number in range(40))}
    steps = [after - before for before, after in itertools.pairwise(audience.clocks[before:])]
    assert SECOND // 25 in steps
    assert min(steps) < 0
    process.interrupt()
    assert process.wait() == 0
    process.wait_for_line(r"replayed \d+ messages in .* late .* ms \(median\)")


def test_topics_are_renamed_and_left_out(process, bag, audience):
    heard = []
    audience.hear("/robot/talk", lambda message: heard.append(int(message.data)))
    process = process(
        *("rpud", "replay", bag, "--rate", "10", "--start", "0.5", "--duration", "1"),
        "--wait-for-subscribers",
        *("--exclude", "/rpud/chat", "--remap", f"{REPLAYED}:=/robot/talk"),
    )
    assert process.wait() == 0
    process.wait_for_line("replayed 21 messages")
    audience.until(lambda: heard == list(range(10, 31)))
    assert audience.numbers == []
    # The rules are the command's own, and no old form of ROS arguments.
    assert "deprecated" not in process.output


def test_all_messages_are_replayed_whatever_the_statistics_say(process, audience, tmp_path):
    """Also those that no subscriber could read are counted, and the exit code says so."""
    messages = [
        (REPLAYED, number * STEP, serialized_string(str(number)) if number % 2 else b"\0\7\0\0")
        for number in range(8)
    ]
    wrong = {"message_start_time": 2 * STEP, "message_end_time": 5 * STEP}
    (tmp_path / "a.mcap").write_bytes(RawMcap([*messages], statistics=wrong).content())
    process = process("replayer", tmp_path / "a.mcap", "--wait-for-subscribers")
    assert process.wait() == 3
    process.wait_for_line("replayed 4 messages .*, 4 messages left out")
    audience.until(lambda: audience.numbers == [1, 3, 5, 7])


def test_a_hurried_replay_loses_nothing(process, audience, tmp_path):
    talk = Topic("/long", STRING, STRING_HASH, (RecordedProfile(),))
    count = 12_000
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(talk, STRING_DEFINITION)
        for number in range(count):
            writer.write("/long", serialized_string(str(number)), START + number * SECOND, START)
    # It keeps what comes, until there is no more room, and takes it more slowly than it is sent.
    node = rclpy.create_node("slow", context=audience.node.context)
    subscription = node.create_subscription(
        String, "/long", lambda message: None, QoSProfile(depth=100_000), raw=True
    )
    process = process("replayer", tmp_path / "bag", "--rate", "1e6", "--wait-for-subscribers")
    heard = []

    def take(most):
        for _ in range(most):
            if taken := subscription.handle.take_message(String, True):
                heard.append(taken[0])
        return len(heard) == count

    until(lambda: take(100) or not process.running)
    take(count)
    node.destroy_node()
    numbers = [int(deserialize_message(data, String).data) for data in heard]
    missing = sorted(set(range(count)) - set(numbers))
    assert not missing, process.output
    assert numbers == list(range(count))
    assert process.wait() == 0
