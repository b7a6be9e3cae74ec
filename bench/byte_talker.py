"""Publishes messages of a size at a rate to its first subscriber; prints how many."""

from __future__ import annotations

import argparse
import random
import time

import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt8MultiArray

_DEPTH = 10_000  # half a second of the quickest
_BURST = 0.001  # messages of this time go together [s]
_ACKNOWLEDGEMENT = 20.0  # [s]


def main() -> None:
    """Talk."""
    parser = argparse.ArgumentParser()
    parser.add_argument("topic")
    parser.add_argument("--size", type=int, required=True)
    parser.add_argument("--rate", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--alone", action="store_true", help="begin although nobody listens")
    arguments = parser.parse_args()
    content = serialize_message(UInt8MultiArray(data=random.Random(0).randbytes(arguments.size)))
    rclpy.init()
    node = rclpy.create_node("byte_talker")
    # A depth of 100 MB at most: large messages that wait take memory.
    depth = min(_DEPTH, max(10, 100_000_000 // arguments.size))
    publisher = node.create_publisher(UInt8MultiArray, arguments.topic, QoSProfile(depth=depth))
    while not (arguments.alone or publisher.get_subscription_count()):
        time.sleep(0.01)
    time.sleep(0.5)  # the match is known there as well
    print("begins", flush=True)
    count, began = 0, time.monotonic()
    while (elapsed := time.monotonic() - began) < arguments.seconds:
        due = int((elapsed + _BURST) * arguments.rate)
        for _ in range(due - count):
            publisher.publish(content)
        count = max(count, due)
        time.sleep(_BURST)
    print(f"published {count} in {time.monotonic() - began}", flush=True)
    publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGEMENT))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
