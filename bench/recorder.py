"""The recorder: how many messages and bytes per second it takes, and whether it loses any.

Where `ros2 bag` is installed, it records the same messages of the same publisher in the next turn.
"""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bench.machine import used_by
from bench.quiet import undisturbed
from bench.row import Goal, Row, row
from rpud_sim.bag import BagReader, BagWriter, Message, Topic
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.message_queue import Declaration, MessageQueue
from rpud_sim.ros.record.writing_thread import WritingThread

SECONDS = 5.0  # of talking
RATES: Mapping[int, Sequence[int]] = {
    100: (10_000, 20_000, 30_000, 40_000, 45_000, 50_000),
    1_000_000: (20, 50, 100, 200),
}
STARTS = 5
GROWTH_MESSAGES = (1_000, 10_000, 100_000, 1_000_000)
GROWTH_TOPICS = (1, 10, 100, 1_000)
_PER_TOPIC = 100
_KIND = "std_msgs/msg/UInt8MultiArray"
_RPUD = (sys.executable, "-m", "rpud_sim.cli.main")
_ENDING = 120.0  # [s]
_STARTING = 4.0  # until a recorder that started is stopped [s]


class _Recorded(NamedTuple):
    """What became of messages: published in how many seconds, recorded, and the share of a core."""

    published: int
    elapsed: float
    recorded: int
    share: float


def recorder() -> Iterator[Row]:
    """Record the drill's own mix, and small and large messages at rising rates."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _starts(Path(folder))
        yield from _drill(Path(folder, "drill"))
        for size, rates in RATES.items():
            greatest: dict[str, float] = {}
            for rate in rates:
                for name in _recorders("", Path()):
                    found = undisturbed(partial(_talk, name, Path(folder), size, rate))
                    what = f"{name}, {size:,} bytes at {rate:,} per second"
                    yield row(f"{what}: published", [found.published / found.elapsed], "1/s")
                    yield row(f"{what}: lost", [found.published - found.recorded])
                    yield row(f"{what}: share of one core", [100.0 * found.share], "%")
                    if found.recorded == found.published:
                        best = found.recorded / found.elapsed
                        greatest[name] = max(greatest.get(name, 0.0), best)
            for name, best in greatest.items():
                what = f"{name}, {size:,} bytes: most without loss"
                small = name == "rpud record" and size == min(RATES)
                goal = Goal(least=40_000) if small else None
                yield row(what, [best], "messages/s", goal)
                yield row(what, [best * size], "B/s")


def _recorders(topic: str, bag: Path) -> dict[str, Sequence[str]]:
    """Commands that record a topic, by what the table calls them."""
    found: dict[str, Sequence[str]] = {"rpud record": (*_RPUD, "record", topic, "--out", str(bag))}
    if importlib.util.find_spec("ros2bag") is not None:
        words = ("ros2", "bag", "record", "--storage", "mcap", "--output", str(bag))
        found["ros2 bag record"] = (*words, "--topics", topic)
    return found


def growth() -> Iterator[tuple[str, float, float]]:
    """Yield curve, amount and processor time [s] of recordings, without ROS: queue and bag."""
    for size in range(len(GROWTH_MESSAGES)):
        for what, amount, topics, each in (
            ("messages", GROWTH_MESSAGES[size], 1, GROWTH_MESSAGES[size]),
            ("topics", GROWTH_TOPICS[size], GROWTH_TOPICS[size], _PER_TOPIC),
        ):
            with tempfile.TemporaryDirectory() as folder:
                yield f"recorder ({what})", amount, _cost(Path(folder, "bag"), topics, each)


def _cost(path: Path, topics: int, count: int) -> float:
    names = [f"/bench/topic_{number}" for number in range(topics)]
    began = time.process_time()
    messages = MessageQueue()
    intake = Intake(messages)
    with BagWriter(path) as bag:
        writing = WritingThread(messages, bag, 1.0, lambda: None)
        writing.start()
        for name in names:
            intake.declare(Declaration(Topic(name, _KIND), None))
        for number in range(topics * count):
            intake.put(Message(names[number % topics], number, number, bytes(100)))
        messages.close()
        writing.join()
    used = time.process_time() - began
    if intake.refused or bag.message_count != topics * count:
        raise RuntimeError(f"of {topics * count} messages the bag has {bag.message_count}")
    return used


def _starts(folder: Path) -> Iterator[Row]:
    """Start recorders beside a publisher: time from the command to the first message in the bag."""
    topic = f"/bench_{os.getpid()}/start"
    words = (sys.executable, "-m", "bench.byte_talker", topic, "--size", "100", "--rate", "100")
    # Another listener is there, or the talker would wait for the recorder with its first message.
    hear = f"""
import rclpy
from std_msgs.msg import UInt8MultiArray as Kind
rclpy.init()
node = rclpy.create_node("hearing")
heard = node.create_subscription(Kind, {topic!r}, lambda _: None, 10)
rclpy.spin(node)
"""
    seconds = str(STARTS * len(_recorders("", Path())) * 8.0)
    with (
        open(os.devnull, "w") as nowhere,
        subprocess.Popen((sys.executable, "-c", hear), stderr=nowhere) as hearing,
        subprocess.Popen(
            (*words, "--seconds", seconds), stdout=subprocess.PIPE, stderr=nowhere, text=True
        ) as talking,
    ):
        try:
            assert talking.stdout is not None
            talking.stdout.readline()  # it begins
            for name in _recorders("", Path()):
                found = []
                for number in range(STARTS):
                    bag = folder / f"{name.split()[0]}_start_{number}"
                    began = time.time_ns()
                    with subprocess.Popen(
                        _recorders(topic, bag)[name], stdout=nowhere, stderr=nowhere
                    ) as recording:
                        time.sleep(_STARTING)
                        recording.send_signal(signal.SIGINT)
                        recording.wait(_ENDING)
                    with BagReader(bag) as reader:
                        found.append((reader.start_time - began) / 1e9)
                goal = Goal(most=1.5) if name == "rpud record" else None
                yield row(f"{name}: start to first message", found, "s", goal)
        finally:
            talking.terminate()
            hearing.terminate()


def _drill(bag: Path) -> Iterator[Row]:
    words = (*_RPUD, "run", "--duration", str(2.0 * SECONDS), "--record", str(bag))
    done = subprocess.run(words, capture_output=True, text=True, timeout=_ENDING, check=True)
    lost = sum(map(int, re.findall(r"lost (\d+) messages", done.stdout)))
    with BagReader(bag) as reader:
        seconds, count = reader.duration / 1e9, reader.message_count
        size = sum(len(message.data) for message in reader.messages())
    yield row("rpud record, the drill's mix: messages per second", [count / seconds], "messages/s")
    yield row("rpud record, the drill's mix: bytes per second", [size / seconds], "B/s")
    yield row("rpud record, the drill's mix: lost", [lost])


def _talk(name: str, folder: Path, size: int, rate: int) -> _Recorded:
    bag = folder / f"bag_{len(os.listdir(folder))}"
    topic = f"/bench_{os.getpid()}/{bag.name}"
    talk = (sys.executable, "-m", "bench.byte_talker", topic, "--size", str(size))
    rates = ("--rate", str(rate), "--seconds", str(SECONDS))
    with (
        open(os.devnull, "w") as nowhere,
        subprocess.Popen(_recorders(topic, bag)[name], stdout=nowhere, stderr=nowhere) as listening,
        subprocess.Popen((*talk, *rates), stdout=subprocess.PIPE, text=True) as talking,
    ):
        try:
            assert talking.stdout is not None
            talking.stdout.readline()  # it begins
            before = used_by(listening.pid)
            said = talking.stdout.readline()
            used = used_by(listening.pid) - before
            talking.wait(_ENDING)
            time.sleep(1.0)
        finally:
            talking.terminate()
            listening.send_signal(signal.SIGINT)
            listening.wait(_ENDING)
    found = re.search(r"published (\d+) in ([0-9.]+)", said)
    if found is None:
        raise RuntimeError(f"the talker did not say what it published, but {said!r}")
    with BagReader(bag) as reader:
        recorded = reader.message_count
    elapsed = float(found[2])
    return _Recorded(int(found[1]), elapsed, recorded, used / elapsed)
