"""Raw listener of a bag's topics: ``python -m bench.replay_listener BAG FILE``.

It takes messages as bytes until it has as many as the bag, or SIGINT, and writes for each topic the
numbers that the middleware gave to the messages and when they arrived [ns].
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from rpud_sim.bag import BagReader
from rpud_sim.ros.graph import message_class
from rpud_sim.ros.process import StopRequest

_DEPTH = 100_000
_BATCH = 1000  # messages of one topic that are taken before the next topic
_PERIOD = 0.002  # between two looks; the middleware has noted when each message arrived [s]


def listen(bag: Path, file: Path) -> None:
    """Receive the topics of a bag, and write what arrived and when."""
    with BagReader(bag) as reader:
        counts = {each.topic.name: each.message_count for each in reader.topics}
        types = {each.topic.name: message_class(each.topic.type) for each in reader.topics}
    heard: dict[str, list[tuple[int, int]]] = {name: [] for name, count in counts.items() if count}
    total, expected = 0, sum(counts.values())
    with StopRequest() as stop:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("listener")
        subscriptions = {
            name: node.create_subscription(
                types[name], name, lambda _: None, QoSProfile(depth=_DEPTH), raw=True
            )
            for name in heard
        }
        while total < expected and not stop.requested:
            before = total
            for name, subscription in subscriptions.items():
                take, kind, note = subscription.handle.take_message, types[name], heard[name].append
                for _ in range(_BATCH):
                    taken = take(kind, True)
                    if taken is None:
                        break
                    about = taken[1]
                    note((about["publication_sequence_number"], about["received_timestamp"]))
                    total += 1
            if total == before:
                stop.wait(_PERIOD)
        file.write_text(json.dumps(heard))
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    listen(Path(sys.argv[1]), Path(sys.argv[2]))
