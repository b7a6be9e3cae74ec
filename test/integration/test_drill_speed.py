"""A drill that drills: its sensors and its status, and simulated time over elapsed time."""

import time
from pathlib import Path

import pytest
from drill_client import SECOND, TELEMETRY, stamps, steps
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rpud_msgs.msg import Status
from support import real_time_permitted

PRIORITY = 10  # the default


@pytest.fixture(scope="module")
def drill(start_module_drill):
    ready = "drilling: regime drilling, weight on bit 8 N, drive on"
    return start_module_drill("/fast", ready, telemetry_rate=50)


@pytest.fixture
def client(drill, connect):
    client = connect("/fast")
    yield client
    set_factor(client, 1.0)


def set_factor(client, factor):
    [result] = client.set_each(real_time_factor=factor)
    assert result.successful, result.reason


@pytest.mark.parametrize(
    "qos", [QoSProfile(depth=10), qos_profile_sensor_data], ids=["default", "sensor data"]
)
def test_every_sensor_is_received_with_default_and_with_sensor_data_qos(client, qos):
    heard = {topic: client.listen(topic, qos) for topic in TELEMETRY}
    client.until(lambda: all(len(messages) >= 20 for messages in heard.values()))

    def ages():
        return [time.time_ns() - stamps(messages[-1:])[0] for messages in heard.values()]

    # Near the wall clock, so that they line up with what other sensors say.
    client.until(lambda: all(abs(age) < SECOND for age in ages()))
    for topic, messages in heard.items():
        assert all(step > 0 and step % 20_000_000 == 0 for step in steps(stamps(messages))), topic


def test_the_status_is_latched_for_who_comes_late_and_comes_each_second(client):
    timings = client.listen("timing")
    status = client.until(lambda: client.status and client.status[0])
    assert (status.state, status.regime) == (Status.STATE_RUNNING, Status.REGIME_DRILLING)
    assert (status.weight_on_bit, status.drive_enabled) == (8.0, True)
    # A machine that is busy may hold one up, for no longer.
    client.until(
        lambda: (
            steps(stamps(client.status[-2:])) == [SECOND]
            and timings[-1].real_time_factor == pytest.approx(1.0, abs=0.3)
        )
    )
    assert client.status[-1].impacts > status.impacts


@pytest.mark.extended
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
