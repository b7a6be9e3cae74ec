"""What plain rclpy clients hear of a drill in another process."""

import time

import pytest
from drill_client import SECOND, TELEMETRY, nanoseconds, stamps, steps
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rpud_msgs.msg import Status


@pytest.fixture(scope="module")
def drill(start_module_drill):
    """One drill for all that only listen."""
    ready = "drilling: regime drilling, weight on bit 8 N, drive on"
    return start_module_drill("/listened", ready)


@pytest.fixture
def client(drill, connect):
    return connect("/listened")


@pytest.mark.parametrize(
    "qos", [QoSProfile(depth=10), qos_profile_sensor_data], ids=["default", "sensor data"]
)
def test_every_sensor_is_received_with_default_and_with_sensor_data_qos(client, qos):
    heard = {topic: client.listen(topic, qos) for topic in TELEMETRY}
    client.until(lambda: all(len(messages) >= 5 for messages in heard.values()))

    def ages():
        return [time.time_ns() - stamps(messages[-1:])[0] for messages in heard.values()]

    # Near the wall clock, so that they line up with what other sensors say.
    client.until(lambda: all(abs(age) < SECOND for age in ages()))
    count = len(heard["nodal_plane"])
    client.until(lambda: len(heard["nodal_plane"]) >= count + 20)
    for topic, messages in heard.items():
        assert all(step > 0 and step % 10_000_000 == 0 for step in steps(stamps(messages))), topic


def test_the_status_is_latched_for_who_comes_late(client):
    heard = client.status
    status = client.until(lambda: heard and heard[0])
    assert status.state == Status.STATE_RUNNING
    assert status.regime == Status.REGIME_DRILLING
    assert (status.weight_on_bit, status.drive_enabled) == (8.0, True)
    assert (status.drive_voltage, status.drive_frequency) == (100.0, 16000.0)
    # A machine that is busy may hold one up, for no longer.
    client.until(
        lambda: (
            len(heard) >= 3
            and steps(stamps(heard[-2:])) == [SECOND]
            and heard[-1].real_time_factor == pytest.approx(1.0, abs=0.3)
        )
    )
    first, second = heard[-2:]
    assert second.impacts > first.impacts
    assert nanoseconds(second.weight_on_bit_applied) == nanoseconds(second.drive_applied)
    assert second.commands_accepted == second.commands_rejected == second.messages_dropped == 0
