"""The writing thread loses nothing, and says so where it cannot help it."""

import threading
import time

import pytest
from sample_bags import START, STRING_DEFINITION, TALK

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message
from rpud_sim.bag.losses import Losses
from rpud_sim.ros.record.disk_room import DiskRoom
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue, NamedRecord
from rpud_sim.ros.record.record_report import late_text, lost_text
from rpud_sim.ros.record.writing_thread import WritingThread


def message(data=b"12345678", topic=TALK.name, log_time=START):
    return Message(topic, log_time, log_time, data)


def test_the_thread_writes_all_that_was_queued(tmp_path):
    messages = MessageQueue()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 1.0, on_end=pytest.fail)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        for number in range(1000):
            assert messages.put(message(str(number).encode(), log_time=START + number))
        messages.close()
        thread.join(10.0)
        assert thread.error is None
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert [int(item.data) for item in bag.messages()] == list(range(1000))


def test_a_failure_to_write_is_reported_at_once(tmp_path):
    messages = MessageQueue()
    failed = threading.Event()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 1.0, on_end=failed.set)
        thread.start()
        messages.put(message(topic="/never/declared"))
        assert failed.wait(10.0)
        thread.join(10.0)
    assert "/never/declared" in str(thread.error)


def test_every_failure_is_reported(tmp_path):
    class Bag(BagWriter):
        def write(self, *_):
            raise OverflowError("not foreseen")

    messages = MessageQueue()
    failed = threading.Event()
    with Bag(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 1.0, on_end=failed.set)
        thread.start()
        messages.put(message())
        assert failed.wait(10.0)
        thread.join(10.0)
    assert "not foreseen" in str(thread.error)


def test_what_was_written_is_flushed_within_the_bound_without_more(tmp_path):
    messages = MessageQueue()
    flushed = threading.Event()

    class Bag(BagWriter):
        def flush(self):
            super().flush()
            flushed.set()

    with Bag(tmp_path / "run") as bag:
        flushed.clear()
        thread = WritingThread(messages, bag, 0.02, on_end=pytest.fail)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        messages.keep(NamedRecord("notes", {"weather": "fine"}))
        messages.put(message(b"safe", log_time=time.time_ns()))
        size = bag.size
        assert flushed.wait(10.0)
        while bag.size == size:  # it may have been the flush before that message
            flushed.clear()
            assert flushed.wait(10.0)
        messages.close()
        thread.join(10.0)
    with rpud_sim.bag.open(tmp_path / "run") as whole:
        assert whole.records("notes") == [{"weather": "fine"}]
        assert whole.message_count == 1


def test_a_full_disk_ends_the_recording_before_the_bag_is_torn(tmp_path):
    class FullDisk(BagWriter):
        def reserve(self, size):
            return self.message_count < 3

    messages = MessageQueue()
    ended = threading.Event()
    with FullDisk(tmp_path / "run") as bag:
        room = DiskRoom(tmp_path, None)
        thread = WritingThread(messages, bag, 1.0, on_end=ended.set, room=room)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        for number in range(10):
            assert messages.put(message(log_time=START + number))
        messages.split()  # a new file would need room, too
        messages.close()
        thread.join(10.0)
        assert ended.is_set()
        assert thread.error is None
        assert thread.refusal == f"the disk of {tmp_path / 'run'} is full"
        assert bag.file_count == 1
    with rpud_sim.bag.open(tmp_path / "run") as whole:
        assert whole.message_count == 3


def test_what_was_late_on_the_disk_is_said_and_no_cause():
    assert late_text(1.0, 1.0) == ""
    assert late_text(7.25, 1.0) == (
        "data was on the disk 7.2 s after it was received, 6.2 s later than --max-loss 1 s allows: "
        "a crash might have cost as much"
    )


def test_how_messages_were_lost_is_said_and_no_cause():
    assert lost_text("/a", Losses(2, 3, 1)) == (
        "lost 6 messages on /a: 2 on the way, 3 for which the queue (--max-cache-size) had no "
        "room, 1 damaged"
    )
    assert lost_text("/a", Losses(None, 3)).startswith("lost 3 messages on /a: 3 for which")


def test_a_disk_too_slow_for_the_bound_is_known(tmp_path):
    messages = MessageQueue()
    slow = threading.Event()

    class SlowBag(BagWriter):
        def flush(self):
            super().flush()
            if self.message_count:
                slow.wait(0.3)

    with SlowBag(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 0.1, on_end=pytest.fail)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        messages.put(message(log_time=time.time_ns()))
        while not thread.exposure:
            assert thread.is_alive()
            time.sleep(0.01)
        messages.close()
        thread.join(10.0)
    assert thread.exposure >= 0.3
