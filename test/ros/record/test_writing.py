"""The writing thread loses nothing, and says so where it cannot help it."""

import dataclasses
import queue
import threading
import time
from types import SimpleNamespace

import pytest
from sample_bags import CHAT, START, STRING_DEFINITION, TALK
from support import PATIENCE

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message, QosProfile
from rpud_sim.ros.record.writing import WriteQueue, WritingThread


def message(data=b"12345678", topic=TALK.name, log_time=START):
    return Message(topic, log_time, log_time, data)


class Writing:
    """A thread that writes what is queued into a bag of some kind."""

    def __init__(self, path, kind=BagWriter, bound=1.0):
        self.path, self.intake, self.ended = path, WriteQueue(), threading.Event()
        self.bag = kind(path)
        self.thread = WritingThread(self.intake, self.bag, bound, self.ended.set)

    def __enter__(self):
        self.bag.__enter__()
        self.thread.start()
        self.intake.declare(TALK, STRING_DEFINITION)
        return self

    def __exit__(self, *error):
        self.intake.close()
        self.thread.join(PATIENCE)
        self.bag.__exit__(*error)

    def put(self, *messages):
        for each in messages:
            self.intake.put(each)

    def failure(self):
        assert self.ended.wait(PATIENCE)
        return str(self.thread.error)


@pytest.fixture
def writing(tmp_path):
    return lambda *arguments: Writing(tmp_path / "run", *arguments)


def test_every_failure_to_write_is_reported_at_once(writing):
    class Failing(BagWriter):
        def write(self, topic, *rest):
            if topic == TALK.name:
                raise OverflowError("not foreseen")
            super().write(topic, *rest)

    with writing(Failing) as run:
        run.put(message())
        assert "not foreseen" in run.failure()


def test_what_was_written_is_flushed_within_the_bound_without_more(writing):
    flushed = queue.Queue()

    class Bag(BagWriter):
        def flush(self):
            super().flush()
            flushed.put(self.message_count)

    with writing(Bag, 0.02) as run:
        run.intake.add_record("notes", {"weather": "fine"})
        run.put(message(b"safe", log_time=time.time_ns()))
        while not flushed.get(timeout=PATIENCE):  # a flush before that message
            pass
    with rpud_sim.bag.open(run.path) as whole:
        assert whole.records("notes") == [{"weather": "fine"}]
        assert whole.message_count == 1


def test_too_little_free_space_ends_the_recording_with_a_whole_bag(writing, monkeypatch):
    free = iter([10**9] * 3)
    monkeypatch.setattr(
        "rpud_sim.ros.record.writing.shutil.disk_usage",
        lambda path: SimpleNamespace(free=next(free, 10**6)),
    )
    size = 2**20  # as often the free space is looked at
    with writing() as run:
        run.put(*(message(bytes(size), log_time=START + number) for number in range(10)))
        run.intake.do(BagWriter.split)  # a new file would need room, too
        assert run.failure() == "None"
    assert run.thread.refusal.endswith(f"has less than --min-free {64 * 2**20} bytes")
    assert run.bag.file_count == 1
    with rpud_sim.bag.open(run.path) as whole:
        assert whole.message_count <= 3


LATCHED = dataclasses.replace(CHAT, offered_qos=(QosProfile(durability="transient_local"),))


@pytest.fixture
def intake():
    """WriteQueue for three messages of eight bytes, in a pause."""
    intake = WriteQueue(capacity=24, paused=True)
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
    intake.pause(False)
    intake.pause(False)
    intake.put(message(b"4"))
    intake.do(BagWriter.split)
    intake.put(message(b"5"))
    intake.pause()
    intake.put(message(b"6"))
    intake.pause(False)
    assert written(intake) == [b"3", b"4", BagWriter.split, b"5"]
    assert not intake.refused


def test_what_does_not_fit_is_counted_for_its_topic_until_there_is_room(intake):
    intake.pause(False)
    for _ in range(5):
        intake.put(message())
    assert (intake.accepted, intake.refused) == (3, {TALK.name: 2})
    while not isinstance(intake.get(0.0), Message):
        pass
    intake.put(message())
    intake.put(message(b"1"))
    assert (intake.accepted, intake.refused) == (4, {TALK.name: 3})


def test_a_small_free_space_is_kept_for_what_is_written_until_the_next_look(writing, monkeypatch):
    least = 64 * 2**20
    monkeypatch.setattr(
        "rpud_sim.ros.record.writing.shutil.disk_usage",
        lambda path: SimpleNamespace(free=least + 2**20),
    )
    with writing() as run:
        run.put(message())
        assert run.failure() == "None"
    assert "has less than --min-free" in run.thread.refusal
