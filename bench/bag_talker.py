"""Publishes a bag's messages, read beforehand, by rclpy alone: the limit of any replay in Python.

``python -m bench.bag_talker BAG RATE SECONDS``: so much of the bag, with the QoS of a replay, each
at its time or as soon as the one before is sent. No thread reads, nothing can be controlled, and
no listener is waited for.
"""

from __future__ import annotations

import gc
import sys
import time
from itertools import takewhile

import rclpy
from rclpy.duration import Duration

from rpud_sim.bag import BagReader
from rpud_sim.ros.lateness import Lateness
from rpud_sim.ros.qos import replay_offer
from rpud_sim.ros.types import message_class

_SETTLING = 0.5  # until the match is known to the listener as well [s]


def talk(bag: str, rate: float, seconds: float) -> None:
    """Publish all once every topic is heard, and print how late they were sent."""
    with BagReader(bag) as reader:
        topics = [each.topic for each in reader.topics if each.message_count]
        last = reader.start_time + round(seconds * 1e9)
        messages = list(takewhile(lambda each: each.log_time <= last, reader.messages()))
    rclpy.init()
    node = rclpy.create_node("bag_talker")
    publishers = {
        topic.name: node.create_publisher(
            message_class(topic.type), topic.name, replay_offer(topic.offered_qos)
        )
        for topic in topics
    }
    while not all(each.get_subscription_count() for each in publishers.values()):
        time.sleep(0.01)
    time.sleep(_SETTLING)
    first = messages[0].log_time
    schedule = [
        ((each.log_time - first) / rate, publishers[each.topic].handle.publish_raw, each.data)
        for each in messages
    ]
    gc.collect()
    gc.freeze()
    lateness, began = Lateness(), time.monotonic_ns()
    for due, publish, data in schedule:
        late = time.monotonic_ns() - began - due
        if late < 0.0:
            time.sleep(-late / 1e9)
            late = time.monotonic_ns() - began - due
        lateness.add(late)
        publish(data)
    took = (time.monotonic_ns() - began) / 1e9
    print(f"published {len(messages)} messages in {took:.3f} s, {lateness}", flush=True)
    for each in publishers.values():
        each.wait_for_all_acked(Duration(seconds=5))
    rclpy.try_shutdown()


if __name__ == "__main__":
    talk(sys.argv[1], float(sys.argv[2]), float(sys.argv[3]))
