"""How exactly and how fast a bag with the drill's own mix of messages is replayed.

Sender and listener are separate processes.
"""

from __future__ import annotations

import json
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.command import RPUD
from bench.table import Row, row
from rpud_sim.bag import BagReader

DURATION = 160.0  # of the bag, at the drill's default rates [s]
SECONDS = 4.0  # that each replay takes
TIMING_RATES = (0.1, 1.0, 10.0)  # times real time
THROUGHPUTS = (16_000, 24_000, 30_000, 34_000, 38_000)  # messages per second
TURNS = 3
ON_TIME = 0.01  # the lateness that 99 % of a sustained replay do not exceed [s]
_ENDING = 60.0  # [s]
_SETTLING = 1.0  # for messages that are still on their way [s]


class _Replayed(NamedTuple):
    """What became of messages: how many were lost, and 99 % of lateness, sent and received [s]."""

    lost: int
    sent: float
    received: float

    @property
    def is_sustained(self) -> bool:
        return not self.lost and self.received <= ON_TIME


def replay() -> Iterator[Row]:
    """Replay the drill's mix to one raw listener: its timing, and the highest sustained rate."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        words = (*RPUD, "simulate", "--bag", str(bag), "--duration", str(DURATION))
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with BagReader(bag) as reader:
            density = 1e9 * reader.message_count / reader.duration  # messages per second
        for rate in TIMING_RATES:
            found = [_turn(bag, rate, Path(folder)) for _ in range(TURNS)]
            name = f"replay of the drill's mix at {rate:g} times real time"
            late = [1e3 * each.sent for each in found]
            goal = 1.0 if rate == 1.0 else None
            yield row(f"{name}: late, sent (99 %)", late, "ms", most=goal)
            yield row(
                f"{name}: late, received (99 %)", [1e3 * each.received for each in found], "ms"
            )
            yield row(f"{name}: lost", [each.lost for each in found])
        kept = 0.0
        for throughput in THROUGHPUTS:
            found = [_turn(bag, throughput / density, Path(folder)) for _ in range(TURNS)]
            what = f"rpud replay, {throughput:,} messages/s of the drill's mix"
            yield row(f"{what}: lost", [each.lost for each in found])
            late = [1e3 * each.received for each in found]
            yield row(f"{what}: late, received (99 %)", late, "ms")
            if statistics.median(each.is_sustained for each in found):
                kept = throughput
        what = "replay: highest rate, none lost, 99 % within 10 ms"
        yield row(what, [kept], "messages/s", least=30_000)


def _turn(bag: Path, rate: float, folder: Path) -> _Replayed:
    """Have a bag's beginning of ``SECONDS`` sent and received."""
    file, duration = folder / "heard.json", str(SECONDS * rate)
    words = (*(*RPUD, "replay", str(bag), "--rate", str(rate), "--duration", duration),)
    listener = subprocess.Popen(
        [sys.executable, "-m", "bench.replay_listener", str(bag), str(file)]
    )
    try:
        sender = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True)
        time.sleep(_SETTLING)
    finally:
        listener.send_signal(signal.SIGINT)
        listener.wait(_ENDING)
    said = re.search(r"([0-9.e+-]+) ms \(99 %\)", sender.stdout)
    if said is None:
        raise RuntimeError(f"the replay did not report its timing: {sender.stdout}")
    lost, errors = _errors(bag, rate, json.loads(file.read_text()))
    return _Replayed(lost, float(said[1]) / 1e3, float(np.percentile(errors, 99)))


def _errors(bag: Path, rate: float, heard: dict[str, list]) -> tuple[int, np.ndarray]:
    """Return the number of lost messages, and the lateness of the others [s].

    The middleware numbers the messages of a topic from one. A message is late after the schedule
    through the earliest arrival.
    """
    due: dict[str, list[int]] = {name: [] for name in heard}
    with BagReader(bag) as reader:
        last = reader.start_time + round(SECONDS * rate * 1e9)
        for block in reader.batches(heard):
            due[block.topic] += block.log_times[block.log_times <= last].tolist()
    sent = sum(map(len, due.values()))
    errors = []
    for name, found in heard.items():
        if found:
            numbers, arrivals = np.array(found, np.int64).T
            errors.append(arrivals - np.array(due[name])[numbers - 1] / rate)
    late = np.concatenate(errors)
    return sent - len(late), (late - late.min()) / 1e9
