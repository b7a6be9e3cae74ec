"""The recorder's queue is bounded, its thread loses nothing, and gaps are counted exactly."""

import queue
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_bags import START, STRING_DEFINITION, TALK

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Message
from rpud_sim.ros.recording import (
    Declaration,
    MessageQueue,
    NamedRecord,
    SequenceGaps,
    WritingThread,
)


def message(data=b"12345678", topic=TALK.name, log_time=START):
    return Message(topic, log_time, log_time, data)


def test_the_queue_keeps_the_order():
    messages = MessageQueue()
    declaration = Declaration(TALK, STRING_DEFINITION)
    messages.declare(declaration)
    assert messages.put(message(b"a"))
    assert messages.put(message(b"b"))
    messages.close()
    assert messages.get(1.0) is declaration
    assert [messages.get(1.0).data, messages.get(1.0).data] == [b"a", b"b"]
    assert messages.get(1.0) is None


def test_the_queue_refuses_what_does_not_fit_until_there_is_room():
    messages = MessageQueue(capacity=20)
    assert messages.put(message())
    assert messages.put(message())
    assert not messages.put(message())
    assert messages.put(message(b"1234"))
    messages.get(1.0)
    assert messages.put(message())
    assert not messages.put(message(b"1"))


def test_an_empty_queue_says_so_in_time():
    with pytest.raises(queue.Empty):
        MessageQueue().get(0.0)


def test_the_thread_writes_all_that_was_queued(tmp_path):
    messages = MessageQueue()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 1.0, on_error=pytest.fail)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        for number in range(1000):
            assert messages.put(message(str(number).encode(), log_time=START + number))
        messages.close()
        thread.join(10.0)
        assert thread.error is None
    with rpud_sim.bag.open(tmp_path / "run") as bag:
        assert [int(item.data) for item in bag.messages()] == list(range(1000))


def test_a_failure_to_write_is_told_at_once(tmp_path):
    messages = MessageQueue()
    failed = threading.Event()
    with BagWriter(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 1.0, on_error=failed.set)
        thread.start()
        messages.put(message(topic="/never/declared"))
        assert failed.wait(10.0)
        thread.join(10.0)
    assert "/never/declared" in str(thread.error)


def test_what_was_written_is_flushed_within_the_bound_without_more(tmp_path):
    messages = MessageQueue()
    flushed = threading.Event()

    class Bag(BagWriter):
        def flush(self):
            super().flush()
            flushed.set()

    with Bag(tmp_path / "run") as bag:
        flushed.clear()
        thread = WritingThread(messages, bag, 0.02, on_error=pytest.fail)
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


def test_a_disk_too_slow_for_the_bound_is_known(tmp_path):
    messages = MessageQueue()
    slow = threading.Event()

    class SlowBag(BagWriter):
        def flush(self):
            super().flush()
            if self.message_count:
                slow.wait(0.3)

    with SlowBag(tmp_path / "run") as bag:
        thread = WritingThread(messages, bag, 0.1, on_error=pytest.fail)
        thread.start()
        messages.declare(Declaration(TALK, STRING_DEFINITION))
        messages.put(message(log_time=time.time_ns()))
        while not thread.exposure:
            assert thread.is_alive()
            time.sleep(0.01)
        messages.close()
        thread.join(10.0)
    assert thread.exposure >= 0.3


@given(st.integers(1, 10**12), st.sets(st.integers(1, 200)))
def test_gaps_of_one_publisher_are_counted_exactly(first, lost):
    gaps = SequenceGaps(lambda: 1)
    arrived = [number for number in range(202) if number not in lost]
    for number in arrived:
        gaps.note(first + number)
    assert gaps.missing == len(lost)


@given(
    st.lists(st.integers(0, 2), max_size=200), st.tuples(*[st.integers(1, 10**6) for _ in range(3)])
)
def test_several_publishers_that_lose_nothing_have_no_gaps(order, firsts):
    # Sequences of different publishers do not touch each other here, as they hardly ever do.
    following = [first + place * 10**7 for place, first in enumerate(firsts)]
    gaps = SequenceGaps(lambda: 3)
    for publisher in order:
        gaps.note(following[publisher])
        following[publisher] += 1
    assert gaps.missing == 0


def test_gaps_of_several_publishers_are_counted():
    gaps = SequenceGaps(lambda: 2)
    for number in (100, 5, 101, 6, 8, 104, 9, 105):
        gaps.note(number)
    assert gaps.missing == 1 + 2


def test_thousands_of_short_publishers_leave_no_gap_and_no_trace():
    gaps = SequenceGaps(lambda: 2)
    for steady in range(5000, 10_000):
        for number in (steady, 1, 2, 3):
            gaps.note(number)
    assert gaps.missing == 0


def test_a_publisher_that_comes_back_begins_anew():
    gaps = SequenceGaps(lambda: 1)
    for number in (7, 8, 9, 1, 2, 5):
        gaps.note(number)
    assert gaps.missing == 2
