"""Bags that are like another one, but for what a test changes."""

from rpud_sim import bag as bags
from rpud_sim.bag.losses import RECORD_NAME


def altered(source, out, change, topics=None):
    """Write a bag anew; `change` gives what to write in place of each message, None for nothing."""
    with bags.open(source) as reader, bags.BagWriter(out) as writer:
        for summary in reader.topics:
            if topics is None or summary.topic.name in topics:
                writer.add_topic(summary.topic, summary.definition)
        for message in reader.messages(topics):
            for data in change(message):
                writer.write(message.topic, data, message.log_time, message.publish_time)
        for record in reader.records(RECORD_NAME):
            writer.add_record(RECORD_NAME, record)
    return out


def unchanged(message):
    """Give a message as it is."""
    return [message.data]
