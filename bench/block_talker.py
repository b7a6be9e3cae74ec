"""Publishes a drill's blocks at their deadlines and does nothing else: the limit of its lateness.

``python -m bench.block_talker NAMESPACE``: the blocks of a second at the default rates, made
beforehand, again and again, with the node's publishers and its priority. It prints a line when all
topics are heard and it begins. Runs until SIGINT, and then prints the quantiles of its lateness
[ms] as JSON: as the node's, it is from a deadline until the last message of the block is published.
"""

from __future__ import annotations

import gc
import itertools
import json
import signal
import sys
import threading
import time
from collections.abc import Mapping

import rclpy
from rclpy.signals import SignalHandlerOptions

from bench.bare_timer import SHARES
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.publishers import DrillPublishers, Encoded
from rpud_sim.ros.lateness import Lateness
from rpud_sim.ros.scheduling import schedule_thread
from rpud_sim.ros.types import message_class
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import offered_topics

_SETTINGS = Settings()
_LOOK_PERIOD = 0.01  # [s]

TOPICS = offered_topics(_SETTINGS.values())
KINDS: Mapping[str, type] = {name: message_class(topic.type) for name, topic in TOPICS.items()}
"""Types of the topics that have to be heard, by name in the namespace."""


def main(namespace: str) -> None:
    """Publish until SIGINT."""
    stop, wake = threading.Event(), threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    publishers = DrillPublishers(
        rclpy.create_node("block_talker", namespace=namespace), False, offered=TOPICS
    )
    blocks = _blocks(publishers)
    while publishers.unheard and not stop.is_set():
        time.sleep(_LOOK_PERIOD)
    schedule_thread(_SETTINGS.thread_priority)
    gc.collect()
    gc.freeze()
    lateness = Lateness()
    print("begun", flush=True)
    due = time.monotonic_ns()
    for block in itertools.cycle(blocks):
        if stop.is_set():
            break
        due += SECOND // len(blocks)
        wake.wait(max(0.0, (due - time.monotonic_ns()) / SECOND))
        publishers.send(block)
        lateness.add(time.monotonic_ns() - due)
    print(json.dumps({key: 1e3 * lateness.quantile(share) for key, share in SHARES.items()}))
    rclpy.try_shutdown()


def _blocks(publishers: DrillPublishers) -> list[list[Encoded]]:
    """Return the messages with a deadline of each block of a second."""
    run = Run(Beginning(_SETTINGS))
    blocks = []
    while run.time < SECOND:
        entries = run.advance_to(run.next_boundary, lambda _: None)
        blocks.append(publishers.encode(entries))
    return blocks


if __name__ == "__main__":
    main(sys.argv[1])
