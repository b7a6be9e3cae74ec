"""How exactly and how fast a bag is replayed, by the replayer's account and by a listener's.

The listener is a process of its own: `python -m bench.replay COUNT FILE` hears that many messages,
or what has come when it is told to stop, and writes when each arrived.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import ContactForce

from bench.row import Row, row
from rpud_sim.bag import BagWriter, QosProfile, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.ros.stopping import StopRequest

TOPIC = "/rpud/contact_force"
BAG_RATE = 100  # messages per second in the bag
SECONDS = 5.0  # that a replay for its timing takes
TIMING_RATES = (0.1, 1.0, 10.0, 100.0)  # times real time
THROUGHPUTS = (5_000, 10_000, 15_000, 20_000, 25_000, 30_000, 40_000)  # messages per second
THROUGHPUT_SECONDS = 3.0
ON_TIME = 0.01  # the lateness that 99 % of a sustained replay do not exceed [s]
_START = 1_700_000_000 * 1_000_000_000


def replay() -> Iterator[Row]:
    """Replay bags to a listener: timing from 0.1 to 100 times real time, and the highest rate."""
    for rate in TIMING_RATES:
        late, errors = _replay(round(SECONDS * BAG_RATE * rate), rate)
        name = f"replay of 100 messages/s at {rate:g} times real time"
        yield row(f"{name}: late, sent (99 %)", [late], "ms")
        for share in (50, 99, 100):
            error = 1e3 * float(np.percentile(errors, share))
            yield row(f"{name}: late, received ({share} %)", [error], "ms")
    sustained = 0
    for throughput in THROUGHPUTS:
        count = round(throughput * THROUGHPUT_SECONDS)
        late, errors = _replay(count, throughput / BAG_RATE)
        if len(errors) < count or late > 1e3 * ON_TIME:
            break
        sustained = throughput
    yield row("replay: highest rate, none lost, 99 % within 10 ms", [sustained], "messages/s")


def _replay(count: int, rate: float) -> tuple[float, np.ndarray]:
    """Replay a bag; return 99 % of the sender's lateness [ms] and the listener's errors [s].

    An error is the time of arrival after the schedule through the earliest arrival.
    """
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        _write(bag, count)
        listener = subprocess.Popen(
            [sys.executable, "-m", "bench.replay", str(count), str(Path(folder, "heard.json"))]
        )
        replayer = subprocess.run(
            [
                *(sys.executable, "-m", "rpud_sim.cli.main", "replay", str(bag)),
                *("--rate", str(rate), "--wait-for-subscribers"),
            ],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        try:
            listener.wait(1.0)
        except subprocess.TimeoutExpired:
            listener.send_signal(signal.SIGINT)
            listener.wait(60.0)
        numbers, arrivals = np.array(json.loads(Path(folder, "heard.json").read_text()))
    said = re.search(r"([0-9.e-]+) ms \(99 %\)", replayer.stdout)
    if said is None:
        raise RuntimeError(f"the replayer did not report its timing: {replayer.stdout}")
    due = numbers * (1e9 / BAG_RATE / rate)
    errors = (arrivals - arrivals[0]) - due
    return float(said[1]), (errors - errors.min()) / 1e9


def _write(path: Path, count: int) -> None:
    kind = "rpud_msgs/msg/ContactForce"
    with BagWriter(path) as writer:
        writer.add_topic(
            Topic(TOPIC, kind, find_type_hash(kind), (QosProfile(depth=10_000),)),
            find_definition(kind),
        )
        for number in range(count):
            at = _START + number * (1_000_000_000 // BAG_RATE)
            writer.write(TOPIC, serialize_message(ContactForce(sequence=number)), at, at)


def listen(count: int, file: Path) -> None:
    """Write numbers and times of arrival [ns] of up to `count` messages."""
    heard = []
    with StopRequest() as stop:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("listener")
        subscription = node.create_subscription(
            ContactForce, TOPIC, lambda message: None, QoSProfile(depth=100_000), raw=True
        )
        while len(heard) < count and not stop.requested:
            # The middleware has noted when each arrived, so that it may be taken later.
            taken = subscription.handle.take_message(ContactForce, True)
            if taken is None:
                stop.wait(0.002)
            else:
                heard.append((taken[0], taken[1]["received_timestamp"]))
        numbers = [deserialize_message(data, ContactForce).sequence for data, _ in heard]
        file.write_text(json.dumps([numbers, [at for _, at in heard]]))
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    listen(int(sys.argv[1]), Path(sys.argv[2]))
