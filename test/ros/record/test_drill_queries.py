"""The recorder asks a drill for the entries of its journal that did not come. Over real DDS."""

import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import JournalEntry, Status
from rpud_msgs.srv import GetJournal
from support import until

from rpud_sim.bag import Message
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.record.drill_queries import JournalQuery
from rpud_sim.ros.record.recorder_node import Recorder
from rpud_sim.ros.record.writing import WriteQueue

LATCHED = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FIRST_TIME = 1_000  # publishing time of entry 0 [ns]


class Drill:
    """A drill that has a journal only, of which a late subscriber gets two entries."""

    def __init__(self):
        self.journal = []
        self.dropped = 0
        self.asked = []
        self.node = rclpy.create_node("drill_node", namespace="/rpud")
        self.publisher = self.node.create_publisher(JournalEntry, "journal", LATCHED)
        self.node.create_service(GetJournal, "~/get_journal", self.answer)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def note(self, count, kind):
        for number in range(len(self.journal), len(self.journal) + count):
            self.journal.append(JournalEntry(sequence=number, kind=kind))
            self.publisher.publish(self.journal[-1])

    def answer(self, request, response):
        self.asked.append(request.first)
        first = max(request.first, self.dropped)
        response.first_kept, response.count = self.dropped, len(self.journal)
        response.entries = self.journal[first : first + 10]
        response.publish_times = [FIRST_TIME + entry.sequence for entry in response.entries]
        return response


class Recording:
    """A recorder without a bag."""

    def __init__(self):
        self.intake = WriteQueue()
        self.node = Recorder(self.intake, RecordOptions(out="bag", topics=()))
        self.query = JournalQuery(self.node)
        self.messages = []

    def turn(self):
        self.node.discover()
        self.node.receive()
        self.query.poll()
        while self.intake._items.qsize():
            item = self.intake.get(1.0)
            if isinstance(item, Message):
                self.messages.append(item)

    @property
    def entries(self):
        return [deserialize_message(message.data, JournalEntry) for message in self.messages]


@pytest.fixture
def drill(nodes):
    drill = Drill()
    nodes.append(drill.node)
    yield drill
    drill.executor.shutdown()


@pytest.fixture
def recording(nodes):
    recording = Recording()
    nodes.append(recording.node)
    return recording


def spun(drill):
    drill.executor.spin_once(timeout_sec=0.001)
    return True


def until_complete(drill, recording, count):
    def complete():
        recording.turn()
        drill.executor.spin_once(timeout_sec=0.001)
        return len(recording.messages) >= count and not recording.query._asking

    until(complete)


def test_a_late_recorder_gets_all_entries_with_their_publishing_times(drill, recording):
    drill.note(35, "drive")
    until_complete(drill, recording, 35)
    assert sorted(entry.sequence for entry in recording.entries) == list(range(35))
    assert [entry.sequence for entry in recording.entries[:3]] == [33, 34, 0]
    assert [message.publish_time for message in recording.messages[2:5]] == [1000, 1001, 1002]
    assert recording.messages[2].log_time >= recording.messages[1].log_time
    drill.note(5, "drive")
    until_complete(drill, recording, 40)
    assert drill.asked == [33, 0, 10, 20, 30]


def test_entries_that_the_last_status_counts_are_asked_for_at_the_end(drill, recording):
    statuses = drill.node.create_publisher(Status, "status", LATCHED)
    drill.note(2, "drive")
    until_complete(drill, recording, 2)
    drill.journal += [JournalEntry(sequence=number, kind="feed") for number in range(2, 30)]
    statuses.publish(Status(journal_entries=30))
    until_complete(drill, recording, 3)
    thread = threading.Thread(target=lambda: until(lambda: spun(drill) and len(drill.asked) == 4))
    thread.start()
    recording.query.finish(30.0)
    thread.join()
    recording.turn()
    journal = [each for each in recording.messages if each.topic == "/rpud/journal"]
    numbers = [deserialize_message(each.data, JournalEntry).sequence for each in journal]
    assert numbers == list(range(30))


def test_entries_that_the_drill_has_dropped_are_named(drill, recording, capfd):
    drill.note(35, "drive")
    drill.dropped = 12
    until_complete(drill, recording, 23)
    assert sorted(entry.sequence for entry in recording.entries) == list(range(12, 35))
    assert "the drill has dropped 12 entries of /rpud/journal" in capfd.readouterr().err


def test_a_drill_that_was_started_again_has_another_journal(drill, recording):
    """The recorder has heard neither the end of the first nor the beginning of the second."""
    drill.note(3, "drive")
    until_complete(drill, recording, 3)
    drill.journal = [JournalEntry(sequence=number, kind="feed") for number in range(20)]
    drill.note(1, "feed")
    until_complete(drill, recording, 24)
    found = [(entry.kind, entry.sequence) for entry in recording.entries]
    assert sorted(found) == sorted(
        [*(("drive", number) for number in range(3)), *(("feed", number) for number in range(21))]
    )
