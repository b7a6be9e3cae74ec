"""The bare programs that the node's lateness is compared with."""

import os

import pytest
import rclpy

from bench.bare_timer import SHARES
from bench.talk import Talk
from bench.telemetry import Bare, hear_blocks, ros

A_SECOND = 100  # blocks, after which it begins again
# What a drill publishes when it has time, and when something changes.
OTHERS = {"waveform", "trajectory", "status", "/diagnostics", "journal", "faults"}


@pytest.fixture(autouse=True)
def initialised():
    with ros():
        yield


@pytest.fixture
def node():
    node = rclpy.create_node("listener")
    yield node
    node.destroy_node()


def test_a_bare_publisher_sends_what_a_drill_publishes_at_its_deadlines(node):
    namespace = f"/blocks_{os.getpid()}"
    hearing = hear_blocks(node, namespace)
    with Bare("block_talker", namespace) as talker:
        blocks = f"{namespace}/drill_tool"
        assert hearing.take_until(lambda: hearing.messages[blocks] > A_SECOND, 60.0)
        late = talker.quantiles()
    heard = {name.rpartition("/")[2] for name, count in hearing.messages.items() if count}
    with Talk("drill_node", {}) as drill:
        drill.settle()
        assert (
            heard - OTHERS
            == {name for name, count in drill.hearing.messages.items() if count} - OTHERS
        )
    assert set(late) == set(SHARES)
    assert 0.0 < late["p50"] <= late["p99"] <= late["p99.9"]
