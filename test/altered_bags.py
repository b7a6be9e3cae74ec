"""Bags that are like another one, except for what a test changes."""

from rpud_sim import bag as bags
from rpud_sim.bag.losses import LOSSES_RECORD


def altered(source, out, change, topics=None):
    """Copy a bag; `change` returns what to write in place of each message, which may be nothing."""
    with bags.open(source) as reader, bags.BagWriter(out) as writer:
        for summary in reader.topics:
            if topics is None or summary.topic.name in topics:
                writer.add_topic(summary.topic, summary.definition)
        for message in reader.messages(topics):
            for data in change(message):
                writer.write(message.topic, data, message.log_time, message.publish_time)
        for record in reader.records(LOSSES_RECORD):
            writer.add_record(LOSSES_RECORD, record)
    return out


def unchanged(message):
    """Return a message as it is."""
    return [message.data]


def flipped(data, place, bit=0):
    """Return data with one bit flipped."""
    changed = bytearray(data)
    changed[place] ^= 1 << bit
    return bytes(changed)


def numbered(topic, number, change):
    """Return a change of the message of that number on a topic, and of no other."""
    count = iter(range(1_000_000))

    def apply(message):
        if message.topic == f"/rpud/{topic}" and next(count) == number:
            return change(message)
        return [message.data]

    return apply


def messages_of(path, topics=None):
    """Return the messages of a bag."""
    with bags.open(path) as opened:
        return list(opened.messages(topics))
