"""The recorder's queue keeps the order, and is bounded."""

import queue

import pytest
from sample_bags import START, STRING_DEFINITION, TALK

from rpud_sim.bag import Message
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue


def message(data=b"12345678"):
    return Message(TALK.name, START, START, data)


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
