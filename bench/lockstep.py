"""How fast a test in lockstep is: alone, with a node that answers, and from pytest to a step."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench.table import ROOT, Row, row
from rpud_sim.testing import LockstepDrill, open_drill

_TURNS = 3
_LONG = 60.0  # of simulation time [s]
_SHORT, _STEPS = 0.1, 100
_ANSWERS = 10.0  # of simulation time with a node that answers [s]
_SUITE = ROOT / "examples" / "test_supervisor.py"
_NODE = """
import rclpy
from rclpy.node import Node
from rpud_msgs.msg import ReactingForce
from std_msgs.msg import Header

class Answering(Node):
    def __init__(self):
        super().__init__("answering", namespace="/rpud")
        self.answer = self.create_publisher(Header, "answer", 10)
        self.create_subscription(ReactingForce, "reacting_force", self.hear, 1000)

    def hear(self, message):
        if message.header.stamp.nanosec % 100_000_000 == 0:
            self.answer.publish(message.header)

rclpy.init()
rclpy.spin(Answering())
"""
_TESTS = """
import pytest

def test_first(drill):
    drill.step(0.1)

def test_second(drill):
    drill.step(0.1)

@pytest.mark.rpud(weight_on_bit=20.0)
def test_other_weight(drill):
    drill.step(0.1)

@pytest.mark.rpud(free_mass=0.004)
def test_other_mass(drill):
    drill.step(0.1)
"""
_DURATION = re.compile(r"([\d.]+)s (?:setup|call|teardown) ")


def lockstep() -> Iterator[Row]:
    """Measure steps in turns, then the suite of the tutorial and the start of a drill."""
    alone, short, answered = list[float](), list[float](), list[float]()
    with open_drill() as drill, tempfile.TemporaryDirectory() as folder:
        node = Path(folder, "answering.py")
        node.write_text(_NODE)
        drill.step(1.0)
        for _ in range(_TURNS):
            alone.append(_speed(drill, _LONG, 1))
            short.append(_speed(drill, _SHORT, _STEPS))
        drill.with_answers("answer")
        drill.start("python", str(node), hears=("reacting_force",))
        drill.step(1.0)
        for _ in range(_TURNS):
            answered.append(_speed(drill, _ANSWERS, 1))
    yield row("a step of 60 s alone: times real time", alone, least=200)
    yield row("hundred steps of 0.1 s alone: times real time", short, least=40)
    what = "a node that receives 100 Hz and answers at 10 Hz: times real time"
    yield row(what, answered, least=20)
    suite = [_wall(_SUITE) for _ in range(_TURNS)]
    yield row("suite of the tutorial: wall time", suite, "s", most=4.7)
    with tempfile.TemporaryDirectory() as folder:
        tests = Path(folder, "test_starts.py")
        tests.write_text(_TESTS)
        durations = [_durations(tests) for _ in range(_TURNS)]
    for number, what in enumerate(("first", "same drill", "other weight", "other mass")):
        values = [each[number] for each in durations]
        yield row(f"a test of one step, {what}: wall time", values, "s")
    yield row("pytest with four such tests: wall time", [each[-1] for each in durations], "s")


def _speed(drill: LockstepDrill, seconds: float, count: int) -> float:
    """Return how many times faster than real time some steps are."""
    begun = time.monotonic()
    for _ in range(count):
        drill.step(seconds)
    return count * seconds / (time.monotonic() - begun)


def _wall(tests: Path) -> float:
    begun = time.monotonic()
    _pytest(tests)
    return time.monotonic() - begun


def _durations(tests: Path) -> list[float]:
    """Return the time of each test with its fixtures [s], and of the whole run."""
    begun = time.monotonic()
    output = _pytest(tests, "--durations=0", "-vv")
    found: dict[str, float] = {}
    for line in output.splitlines():
        if _DURATION.match(line.strip()):
            seconds, _, name = line.split()
            found[name] = found.get(name, 0.0) + float(seconds[:-1])
    names = ("first", "second", "other_weight", "other_mass")
    each = [next(v for k, v in found.items() if k.endswith(f"test_{name}")) for name in names]
    return [*each, time.monotonic() - begun]


def _pytest(tests: Path, *options: str) -> str:
    words = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests), *options)
    done = subprocess.run(words, capture_output=True, text=True, cwd=tests.parent, check=False)
    if done.returncode:
        raise RuntimeError(f"{tests.name} failed: {done.stdout[-500:]}")
    return done.stdout
