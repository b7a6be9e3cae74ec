"""How exactly and how fast a bag with the drill's own mix of messages is replayed.

Sender and listener are processes of their own. By turns the sender is `rpud replay` and a bare loop
that publishes the same bytes, which bounds what a replay can do on this machine.
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
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy

from bench.quiet import undisturbed
from bench.row import Goal, Row, row
from rpud_sim.bag import BagReader, BagWriter, Topic
from rpud_sim.ros.replay.playback import Plan, Playback
from rpud_sim.ros.replay.playback_thread import PlaybackThread
from rpud_sim.ros.replay.read_ahead import ReadAhead
from rpud_sim.ros.replay.replay_options import RATE
from rpud_sim.ros.replay.replayer_node import Replayer

DURATION = 160.0  # of the bag, at the drill's default rates [s]
SECONDS = 4.0  # that each replay takes
TIMING_RATES = (0.1, 1.0, 10.0)  # times real time
THROUGHPUTS = (16_000, 24_000, 30_000, 34_000, 38_000)  # messages per second
TURNS = 3
ON_TIME = 0.01  # the lateness that 99 % of a sustained replay do not exceed [s]
GROWTH_MESSAGES = (300, 3_000, 30_000, 300_000)
GROWTH_TOPICS = (1, 10, 100, 1_000)
_PER_TOPIC = 30
_KIND = "std_msgs/msg/UInt8MultiArray"
_RPUD = (sys.executable, "-m", "rpud_sim.cli.main")
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
    """Replay the drill's mix to one raw listener: its timing, and the highest rate that is kept."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, "bag")
        words = (*_RPUD, "simulate", "--bag", str(bag), "--duration", str(DURATION))
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with BagReader(bag) as reader:
            density = 1e9 * reader.message_count / reader.duration  # messages per second
        for rate in TIMING_RATES:
            found = [_replayed("rpud replay", bag, rate, Path(folder)) for _ in range(TURNS)]
            name = f"replay of the drill's mix at {rate:g} times real time"
            goal = Goal(most=1.0) if rate == 1.0 else None
            yield row(f"{name}: late, sent (99 %)", [1e3 * each.sent for each in found], "ms", goal)
            yield row(
                f"{name}: late, received (99 %)", [1e3 * each.received for each in found], "ms"
            )
            yield row(f"{name}: lost", [each.lost for each in found])
        kept: dict[str, float] = {"rpud replay": 0.0, "bare publisher": 0.0}
        for throughput in THROUGHPUTS:
            turns: dict[str, list[_Replayed]] = {name: [] for name in kept}
            for _ in range(TURNS):
                for name, results in turns.items():
                    results.append(_replayed(name, bag, throughput / density, Path(folder)))
            for name, results in turns.items():
                what = f"{name}, {throughput:,} messages/s of the drill's mix"
                yield row(f"{what}: lost", [each.lost for each in results])
                late = [1e3 * each.received for each in results]
                yield row(f"{what}: late, received (99 %)", late, "ms")
                if statistics.median(each.is_sustained for each in results):
                    kept[name] = throughput
        rule = "none lost, 99 % within 10 ms"
        goal = Goal(least=30_000)
        yield row(f"replay: highest rate, {rule}", [kept["rpud replay"]], "messages/s", goal)
        yield row(f"bare publisher: highest rate, {rule}", [kept["bare publisher"]], "messages/s")


def growth() -> Iterator[tuple[str, float, float]]:
    """Yield curve, amount and processor time [s] of replays as fast as possible, unheard."""
    with tempfile.TemporaryDirectory() as folder:
        _write(Path(folder, "bag"), 1, 1)
        _cost(Path(folder, "bag"))  # loads what the first replay of a process needs
    for size in range(len(GROWTH_MESSAGES)):
        for what, amount, topics, each in (
            ("messages", GROWTH_MESSAGES[size], 1, GROWTH_MESSAGES[size]),
            ("topics", GROWTH_TOPICS[size], GROWTH_TOPICS[size], _PER_TOPIC),
        ):
            with tempfile.TemporaryDirectory() as folder:
                bag = Path(folder, "bag")
                _write(bag, topics, each)
                yield f"replay ({what})", amount, _cost(bag)


def _replayed(name: str, bag: Path, rate: float, folder: Path) -> _Replayed:
    return undisturbed(lambda: _turn(name, bag, rate, folder))


def _turn(name: str, bag: Path, rate: float, folder: Path) -> _Replayed:
    """Have a bag's beginning of ``SECONDS`` sent and heard."""
    file, duration = folder / "heard.json", str(SECONDS * rate)
    senders: dict[str, Sequence[str]] = {
        "rpud replay": (
            *(*_RPUD, "replay", str(bag), "--rate", str(rate), "--duration", duration),
            "--wait-for-subscribers",
        ),
        "bare publisher": (sys.executable, "-m", "bench.bag_talker", str(bag), str(rate), duration),
    }
    listener = subprocess.Popen(
        [sys.executable, "-m", "bench.replay_listener", str(bag), str(file)]
    )
    try:
        sender = subprocess.run(senders[name], stdout=subprocess.PIPE, text=True, check=True)
        time.sleep(_SETTLING)
    finally:
        listener.send_signal(signal.SIGINT)
        listener.wait(_ENDING)
    said = re.search(r"([0-9.e+-]+) ms \(99 %\)", sender.stdout)
    if said is None:
        raise RuntimeError(f"{name} did not report its timing: {sender.stdout}")
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
        for block in reader.blocks(heard):
            due[block.topic] += block.log_times[block.log_times <= last].tolist()
    sent = sum(map(len, due.values()))
    errors = []
    for name, found in heard.items():
        if found:
            numbers, arrivals = np.array(found, np.int64).T
            errors.append(arrivals - np.array(due[name])[numbers - 1] / rate)
    late = np.concatenate(errors)
    return sent - len(late), (late - late.min()) / 1e9


def _write(path: Path, topics: int, count: int) -> None:
    with BagWriter(path) as writer:
        names = [f"/bench/topic_{number}" for number in range(topics)]
        for name in names:
            writer.add_topic(Topic(name, _KIND))
        for number in range(topics * count):
            writer.write(names[number % topics], bytes(100), number, number)


def _cost(path: Path) -> float:
    rclpy.init()
    try:
        with BagReader(path) as bag:
            began = time.process_time()
            node = Replayer(bag.topics, with_clock=False)

            def read(position: int) -> ReadAhead:
                return ReadAhead(bag.messages(None, position - bag.start_time))

            plan = Plan(bag.start_time, bag.end_time, RATE.maximum)
            thread = PlaybackThread(Playback(read, plan, node))
            thread.start()
            thread.join()
            used = time.process_time() - began
            node.destroy_node()
            return used
    finally:
        rclpy.try_shutdown()
