"""The writing thread loses nothing, and says so where it cannot help it."""

import dataclasses
import os
import queue
import threading
import time

import pytest
from sample_bags import CHAT, START, STRING_DEFINITION, TALK

import rpud_sim.bag
from rpud_sim.bag import BagError, BagWriter, Message, QosProfile
from rpud_sim.bag.losses import Losses
from rpud_sim.ros.record.recorder import late_text, lost_text
from rpud_sim.ros.record.writing import DiskRoom, Intake, WritingThread


def message(data=b"12345678", topic=TALK.name, log_time=START):
    return Message(topic, log_time, log_time, data)


def test_the_thread_writes_all_that_was_queued(tmp_path):
    intake = Intake()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(intake, bag, 1.0, on_end=pytest.fail)
        thread.start()
        intake.declare(TALK, STRING_DEFINITION)
        for number in range(1000):
            intake.put(message(str(number).encode(), log_time=START + number))
        intake.close()
        thread.join(10.0)
        assert thread.error is None
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert [int(item.data) for item in bag.messages()] == list(range(1000))


def test_a_failure_to_write_is_reported_at_once(tmp_path):
    intake = Intake()
    failed = threading.Event()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(intake, bag, 1.0, on_end=failed.set)
        thread.start()
        intake.put(message(topic="/never/declared"))
        assert failed.wait(10.0)
        thread.join(10.0)
    assert "/never/declared" in str(thread.error)


def test_every_failure_is_reported(tmp_path):
    class Bag(BagWriter):
        def write(self, *_):
            raise OverflowError("not foreseen")

    intake = Intake()
    failed = threading.Event()
    with Bag(tmp_path / "run") as bag:
        thread = WritingThread(intake, bag, 1.0, on_end=failed.set)
        thread.start()
        intake.put(message())
        assert failed.wait(10.0)
        thread.join(10.0)
    assert "not foreseen" in str(thread.error)


def test_what_was_written_is_flushed_within_the_bound_without_more(tmp_path):
    intake = Intake()
    flushed = threading.Event()

    class Bag(BagWriter):
        def flush(self):
            super().flush()
            flushed.set()

    with Bag(tmp_path / "run") as bag:
        flushed.clear()
        thread = WritingThread(intake, bag, 0.02, on_end=pytest.fail)
        thread.start()
        intake.declare(TALK, STRING_DEFINITION)
        intake.add_record("notes", {"weather": "fine"})
        intake.put(message(b"safe", log_time=time.time_ns()))
        size = bag.size
        assert flushed.wait(10.0)
        while bag.size == size:  # it may have been the flush before that message
            flushed.clear()
            assert flushed.wait(10.0)
        intake.close()
        thread.join(10.0)
    with rpud_sim.bag.open(tmp_path / "run") as whole:
        assert whole.records("notes") == [{"weather": "fine"}]
        assert whole.message_count == 1


def test_a_full_disk_ends_the_recording_before_the_bag_is_torn(tmp_path):
    class FullDisk(BagWriter):
        def reserve(self, size):
            return self.message_count < 3

    intake = Intake()
    ended = threading.Event()
    with FullDisk(tmp_path / "run") as bag:
        thread = WritingThread(intake, bag, 1.0, on_end=ended.set)
        thread.start()
        intake.declare(TALK, STRING_DEFINITION)
        for number in range(10):
            intake.put(message(log_time=START + number))
        intake.do(BagWriter.split)  # a new file would need room, too
        intake.close()
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
    intake = Intake()
    slow = threading.Event()

    class SlowBag(BagWriter):
        def flush(self):
            super().flush()
            if self.message_count:
                slow.wait(0.3)

    with SlowBag(tmp_path / "run") as bag:
        thread = WritingThread(intake, bag, 0.1, on_end=pytest.fail)
        thread.start()
        intake.declare(TALK, STRING_DEFINITION)
        intake.put(message(log_time=time.time_ns()))
        while not thread.exposure:
            assert thread.is_alive()
            time.sleep(0.01)
        intake.close()
        thread.join(10.0)
    assert thread.exposure >= 0.3


def test_the_limit_holds_for_the_closed_bag(tmp_path):
    room = DiskRoom(tmp_path, 1000)
    assert room.refusal(900, 100) == ""
    assert room.refusal(900, 101) == "it has reached --max-disk 1000 bytes"


def test_without_a_limit_the_disk_is_one(tmp_path):
    disk = os.statvfs(tmp_path)
    free = disk.f_bavail * disk.f_frsize
    room = DiskRoom(tmp_path, None)
    assert room.refusal(0, 1) == ""
    # Between two looks the growth of the bag is known.
    assert f"the disk of {tmp_path} has" in room.refusal(2 * free, 1)
    assert f"the disk of {tmp_path} has" in DiskRoom(tmp_path, None).refusal(0, 2 * free)


def test_a_disk_that_is_gone_is_an_error(tmp_path):
    with pytest.raises(BagError, match="cannot look at"):
        DiskRoom(tmp_path / "gone", None).refusal(0, 1)


LATCHED = dataclasses.replace(CHAT, offered_qos=(QosProfile(durability="transient_local"),))


@pytest.fixture
def intake():
    """Intake for three messages of eight bytes, in a pause."""
    intake = Intake(capacity=24, paused=True)
    intake.declare(TALK, STRING_DEFINITION)
    intake.declare(LATCHED, STRING_DEFINITION)
    return intake


def written(intake):
    """Give the messages in the queue, and other items that are no declarations."""
    intake.close()
    return [
        item.data if isinstance(item, Message) else item
        for item in iter(lambda: intake.get(0.0), None)
    ][2:]


def test_in_a_pause_messages_are_left_out_but_the_last_latched_one(intake):
    intake.put(message(b"1"))
    intake.put(message(b"2", LATCHED.name))
    intake.put(message(b"3", LATCHED.name))
    intake.resume()
    intake.resume()
    intake.put(message(b"4"))
    intake.do(BagWriter.split)
    intake.put(message(b"5"))
    intake.pause()
    intake.put(message(b"6"))
    intake.resume()
    assert written(intake) == [b"3", b"4", BagWriter.split, b"5"]
    assert not intake.refused


def test_what_does_not_fit_is_counted_for_its_topic_until_there_is_room(intake):
    intake.resume()
    for _ in range(5):
        intake.put(message())
    assert (intake.accepted, intake.refused) == (3, {TALK.name: 2})
    while not isinstance(intake.get(0.0), Message):
        pass
    intake.put(message())
    intake.put(message(b"1"))
    assert (intake.accepted, intake.refused) == (4, {TALK.name: 3})


def test_an_empty_queue_says_so_in_time():
    with pytest.raises(queue.Empty):
        Intake().get(0.0)
