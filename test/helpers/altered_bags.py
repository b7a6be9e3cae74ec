"""Bags that are like another one, except for what a test changes."""

import json
from contextlib import suppress
from dataclasses import replace

from rpud_sim import bag as bags
from rpud_sim.bag.metadata import LOSSES_RECORD
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import installed_codec


def unchanged(message):
    """Return a message as it is."""
    return [message.data]


def copied(writer, source, change=unchanged, topics=None, shift=0, namespace="/rpud", delay=0):
    """Write the messages of a bag later by a time [ns], and in a namespace.

    `change` returns what to write in place of each message, which may be nothing. Messages are
    received with a `delay` [ns].
    """
    with bags.open(source) as reader:
        for summary in reader.topics:
            if topics is None or summary.topic.name in topics:
                name = summary.topic.name.replace("/rpud", namespace)
                with suppress(bags.BagError):  # another bag has it too
                    writer.add_topic(replace(summary.topic, name=name), summary.definition)
        for message in reader.messages(topics):
            name = message.topic.replace("/rpud", namespace)
            for data in change(message):
                received = message.log_time + shift + delay
                writer.write(name, data, received, message.publish_time + shift)


def altered(source, out, change, topics=None):
    """Copy a bag with its losses."""
    with bags.BagWriter(out) as writer:
        copied(writer, source, change, topics)
        with bags.open(source) as reader:
            for record in reader.records(LOSSES_RECORD):
                writer.add_record(LOSSES_RECORD, record)
    return out


def merged(out, *parts, delay=1000):
    """Write a bag of several: each with the time that is added to it [ns], and its namespace."""
    with bags.BagWriter(out) as writer:
        for source, shift, namespace in parts:
            copied(writer, source, shift=shift, namespace=namespace, delay=delay)
    return out


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


def edited(edit):
    """Return a change of the journal's entries: `edit` gets the fields of each, and its content."""
    codec = installed_codec("rpud_msgs/msg/JournalEntry")

    def apply(message):
        if message.topic != "/rpud/journal":
            return [message.data]
        fields = to_plain(codec.decode(message.data))
        content = json.loads(fields["content"])
        edit(fields, content)
        if content != json.loads(fields["content"]):
            fields["content"] = json.dumps(content)
        return [codec.encode(fields)]

    return apply
