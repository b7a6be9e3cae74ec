"""What bags of more and more messages, topics and channels cost, and sweeps of more simulations."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.checkout import Checkout, work_tree
from bench.growth import Point
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.cdr import Codec

MESSAGES = (1_000, 10_000, 100_000, 1_000_000)
COUNTS = (1, 10, 100, 1_000)  # of topics, and of channels of a topic
SIMULATIONS = (20, 200, 2_000, 20_000)
REPEATS = 3

_EACH = 100  # messages on each topic, and with each number of channels
_KIND = "bench_msgs/msg/Channels"
_PERIOD = 1_000_000  # of messages [ns]
_SWEEP = """
design: latin_hypercube
points: {points}
repeat: 10
duration: 0.05
swept:
  weight_on_bit: {{minimum: 5.0, maximum: 20.0}}
"""


def growth() -> Iterator[Point]:
    """Time `info` and `export` of such bags, and sweeps."""
    with work_tree() as version:
        for _ in _costs(version, 0):
            pass  # Python compiles what it imports for the first time
        for _ in range(REPEATS):
            for size in range(len(COUNTS)):
                yield from _costs(version, size)


def _costs(version: Checkout, size: int) -> Iterator[Point]:
    bags = {
        "messages": (MESSAGES[size], 1, 1, MESSAGES[size]),
        "topics": (COUNTS[size], COUNTS[size], 1, _EACH),
        "channels of a topic": (COUNTS[size], 1, COUNTS[size], _EACH),
    }
    for what, (amount, *shape) in bags.items():
        with tempfile.TemporaryDirectory() as name:
            bag = write_bag(Path(name, "bag"), *shape)
            for work, words in {"info": (), "export": ("--out", Path(name, "out"))}.items():
                used = version.run(["rpud", work, bag, *words])
                yield Point(f"{work} ({what})", amount, used.processor)
    with tempfile.TemporaryDirectory() as name:
        specification = Path(name, "sweep.yaml")
        specification.write_text(_SWEEP.format(points=SIMULATIONS[size] // 10))
        used = version.run(["rpud", "sweep", specification, "--out", Path(name, "out")])
        yield Point("sweep (simulations)", SIMULATIONS[size], used.processor)


def write_bag(path: Path, topics: int, channels: int, messages: int) -> Path:
    """Write a bag of numbers, not compressed.

    Args:
        path: of the new bag.
        topics: their number.
        channels: numbers in each message.
        messages: on each topic, one every millisecond.
    """
    names: Sequence[str] = [f"channel_{number}" for number in range(channels)]
    definition = "".join(f"float64 {name}\n" for name in names)
    data = Codec(_KIND, definition).encode({name: 0.5 * at for at, name in enumerate(names)})
    with BagWriter(path, compression="none") as bag:
        for number in range(topics):
            bag.add_topic(Topic(f"/bench/topic_{number}", _KIND), definition)
        for message in range(messages):
            for number in range(topics):
                at = message * _PERIOD + number
                bag.write(f"/bench/topic_{number}", data, at, at)
    return path
