"""How fast a test in lockstep is: alone, with a node that answers, and from pytest to a step."""

from __future__ import annotations

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
        self.create_subscription(ReactingForce, "reacting_force", self.receive, 1000)

    def receive(self, message):
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


def lockstep() -> Iterator[Row]:
    """Measure steps in turns, then the suite of the tutorial and the start of a drill."""
    alone, short, answered = list[float](), list[float](), list[float]()
    with tempfile.TemporaryDirectory() as folder:
        with open_drill() as drill:
            node = Path(folder, "answering.py")
            node.write_text(_NODE)
            drill.step(1.0)
            for _ in range(_TURNS):
                alone.append(_speed(drill, _LONG, 1))
                short.append(_speed(drill, _SHORT, _STEPS))
            drill.with_answers("answer")
            drill.start("python", str(node), subscribes_to=("reacting_force",))
            drill.step(1.0)
            for _ in range(_TURNS):
                answered.append(_speed(drill, _ANSWERS, 1))
        tests = Path(folder, "test_starts.py")
        tests.write_text(_TESTS)
        suite = [_pytest(_SUITE) for _ in range(_TURNS)]
        four = [_pytest(tests) for _ in range(_TURNS)]
    yield row("a step of 60 s alone: times real time", alone, least=200)
    yield row("hundred steps of 0.1 s alone: times real time", short, least=60)
    what = "a node that receives 100 Hz and answers at 10 Hz: times real time"
    yield row(what, answered, least=40)
    yield row("suite of the tutorial: wall time", suite, "s", most=7.0)
    yield row("pytest with four tests of one step: wall time", four, "s", most=1.8)


def _speed(drill: LockstepDrill, seconds: float, count: int) -> float:
    """Return how many times faster than real time some steps are."""
    begun = time.monotonic()
    for _ in range(count):
        drill.step(seconds)
    return count * seconds / (time.monotonic() - begun)


def _pytest(tests: Path) -> float:
    """Return the wall time of pytest with a file of tests [s]."""
    words = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests))
    begun = time.monotonic()
    done = subprocess.run(words, capture_output=True, text=True, cwd=tests.parent, check=False)
    if done.returncode:
        raise RuntimeError(f"{tests.name} failed: {done.stdout[-500:]}")
    return time.monotonic() - begun
