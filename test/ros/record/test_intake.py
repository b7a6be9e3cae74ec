"""What is taken is written, or left out in a pause; nothing goes unnoticed."""

import dataclasses

from sample_bags import CHAT, START, STRING_DEFINITION, TALK

from rpud_sim.bag import Message, QosProfile
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue, Split

LATCHED = dataclasses.replace(CHAT, offered_qos=(QosProfile(durability="transient_local"),))


def message(number, topic=TALK.name, size=10):
    return Message(topic, START + number, START + number, bytes([number]) * size)


def started(messages, **options):
    intake = Intake(messages, **options)
    intake.declare(Declaration(TALK, STRING_DEFINITION))
    intake.declare(Declaration(LATCHED, STRING_DEFINITION))
    return intake


def written(messages):
    """Give the numbers of the messages in the queue, `split` between files."""
    messages.close()
    items = iter(lambda: messages.get(0.0), None)
    return [
        "split" if isinstance(item, Split) else item.data[0]
        for item in items
        if not isinstance(item, Declaration)
    ]


def test_in_a_pause_messages_are_left_out():
    messages = MessageQueue()
    intake = started(messages, paused=True)
    intake.put(message(1))
    intake.resume()
    intake.put(message(2))
    intake.pause()
    intake.put(message(3))
    assert written(messages) == [2]
    assert not intake.refused


def test_what_latched_topics_said_in_a_pause_is_written_after_it():
    messages = MessageQueue()
    intake = started(messages, paused=True)
    for number in (1, 2):
        intake.put(message(number, LATCHED.name))
    intake.resume()
    intake.resume()
    intake.pause()
    intake.resume()
    assert written(messages) == [2]


def test_a_split_stands_between_the_messages():
    messages = MessageQueue()
    intake = started(messages)
    intake.put(message(1))
    intake.split()
    intake.put(message(2))
    assert written(messages) == [1, "split", 2]


def test_what_the_queue_refuses_is_counted_for_its_topic():
    messages = MessageQueue(capacity=25)
    intake = started(messages)
    for number in range(5):
        intake.put(message(number))
    assert (intake.accepted, intake.refused) == (2, {TALK.name: 3})
