"""Simulated time over elapsed time: as the parameter says, and it may change meanwhile."""

import time
from pathlib import Path

import pytest
from drill_client import SECOND, nanoseconds
from rclpy.qos import QoSProfile
from support import real_time_permitted

RATE = 50
PRIORITY = 10  # the default


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/fast", publish_clock=True, telemetry_rate=RATE)


@pytest.fixture
def client(drill, connect):
    return connect("/fast")


def set_factor(client, factor):
    [result] = client.set_each(real_time_factor=factor)
    assert result.successful, result.reason


def measured(client, clocks, ticks):
    """Give simulated over elapsed time from one tick to a later one."""

    def now():
        return nanoseconds(clocks[-1].clock)

    clocks.clear()
    client.until(lambda: clocks)
    began, begin = time.monotonic(), now()
    client.until(lambda: now() >= begin + ticks * SECOND // RATE)
    return (now() - begin) / SECOND / (time.monotonic() - began)


@pytest.mark.extended
@pytest.mark.parametrize(("factor", "ticks"), [(0.1, 8), (1.0, 50), (5.0, 250)])
def test_time_passes_at_the_given_factor(client, factor, ticks):
    clocks, statuses = client.listen("/clock"), client.status
    set_factor(client, factor)
    client.until(lambda: statuses and statuses[-1].lag == 0.0)
    # In time, or in time again on a busy machine.
    client.until(lambda: measured(client, clocks, ticks) == pytest.approx(factor, rel=0.1))
    count = len(statuses)
    client.until(
        lambda: (
            statuses[-1].real_time_factor == pytest.approx(factor, rel=0.2)
            and len(statuses) > count + 1
        )
    )


def test_a_factor_of_zero_waits_for_nothing_but_its_listeners(client):
    # Python hears slower than the drill drills: what waits for it is in its own queue.
    endless = QoSProfile(depth=1_000_000)
    clocks, impacts = client.listen("/clock"), client.listen("contact_force", endless)
    client.until(lambda: impacts)
    set_factor(client, 0.0)
    count = len(impacts)
    client.until(lambda: measured(client, clocks, 100) > 1.0)
    # They hear every impact all the same.
    client.until(lambda: len(impacts) > count + 5000)
    sequences = [message.sequence for message in impacts]
    assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    set_factor(client, 1.0)


def priorities(process):
    """Give the real-time priorities of the process' threads that have one."""
    found = []
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        fields = (task / "stat").read_text().rpartition(")")[2].split()
        found.append(int(fields[37]))
    return [priority for priority in found if priority]


@pytest.mark.parametrize(("factor", "punctual"), [(1.0, True), (0.0, False), (0.5, True)])
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
    set_factor(client, 1.0)
