"""Simulated time over elapsed time: as the parameter says, and it may change meanwhile."""

import time
from pathlib import Path

import pytest
from drill_client import SECOND, nanoseconds
from rclpy.qos import QoSProfile
from support import real_time_permitted

PRIORITY = 10  # the default


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/fast", publish_clock=True, telemetry_rate=50)


@pytest.fixture
def client(drill, connect):
    client = connect("/fast")
    yield client
    set_factor(client, 1.0)


def set_factor(client, factor):
    [result] = client.set_each(real_time_factor=factor)
    assert result.successful, result.reason


@pytest.mark.extended
def test_time_passes_at_the_given_factor(client):
    """A slow one, with which a busy machine keeps up."""
    clocks, statuses = client.listen("/clock"), client.status
    set_factor(client, 0.1)

    def measured():
        clocks.clear()
        client.until(lambda: clocks)
        began, begin = time.monotonic(), nanoseconds(clocks[-1].clock)
        client.until(lambda: nanoseconds(clocks[-1].clock) >= begin + SECOND // 6)
        return (nanoseconds(clocks[-1].clock) - begin) / SECOND / (time.monotonic() - began)

    client.until(lambda: statuses and statuses[-1].lag == 0.0)
    client.until(lambda: measured() == pytest.approx(0.1, rel=0.1))
    client.until(lambda: statuses[-1].real_time_factor == pytest.approx(0.1, rel=0.2))


def test_a_factor_of_zero_waits_for_its_listeners(client):
    # Python hears slower than the drill drills: what waits for it is in its own queue.
    impacts = client.listen("contact_force", QoSProfile(depth=1_000_000))
    client.until(lambda: impacts)
    set_factor(client, 0.0)
    count = len(impacts)
    client.until(lambda: len(impacts) > count + 1000)
    sequences = [message.sequence for message in impacts]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))


def priorities(process):
    """Give the real-time priorities of the process' threads that have one."""
    found = []
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        found.append(int(fields[37]))
    return [priority for priority in found if priority]


@pytest.mark.parametrize(("factor", "punctual"), [(0.0, False), (0.5, True)])
def test_the_drill_goes_before_others_while_it_keeps_a_time(client, drill, factor, punctual):
    timings = client.listen("/diagnostics")

    def said():
        return {pair.key: pair.value for pair in timings[-1].status[0].values}["scheduling"]

    set_factor(client, factor)
    if punctual and real_time_permitted():
        client.until(lambda: timings and said() == f"real-time priority {PRIORITY}")
        assert priorities(drill) == [PRIORITY]
    else:
        client.until(lambda: timings and said().startswith("time-sharing"))
        assert priorities(drill) == []
