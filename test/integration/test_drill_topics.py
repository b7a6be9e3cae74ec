"""What plain rclpy clients hear of a drill in another process."""

import time

import pytest
from drill_client import SECOND, TELEMETRY, nanoseconds, stamps, steps
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rpud_msgs.msg import Drive, Result, Status


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


def test_the_diagnostics_count_what_is_refused_and_say_why(client):
    heard = client.listen("/diagnostics")

    def latest(key):
        found = [
            pair.value
            for message in heard
            for status in message.status
            if status.name == "/listened/drill_node: commands"
            for pair in status.values
            if pair.key == key
        ]
        return found[-1] if found else None

    before = int(client.until(lambda: latest("requests_refused")))
    assert not client.inject("no_such_kind").success
    client.until(lambda: latest("requests_refused") == str(before + 1))
    assert "no_such_kind" in latest("last_refusal")
    [result] = client.set_each(weight_on_bit=-1.0)
    assert not result.successful
    client.until(lambda: latest("requests_refused") == str(before + 2))
    assert latest("last_refusal") == result.reason
    assert client.reset(8).result != Result.RESULT_OK
    client.until(lambda: latest("requests_refused") == str(before + 3))
    assert latest("last_refusal") == "scope 8 is unknown"


def test_applied_commands_come_back_with_the_time_at_which_they_took_effect(client):
    client.command(Drive(enabled=True, voltage=80.0, frequency=17000.0))
    status = client.until(
        lambda: next((it for it in client.status if it.drive_frequency == 17000.0), None)
    )
    assert status.drive_voltage == 80.0
    trajectories = client.listen("trajectory")
    client.until(lambda: trajectories and 17000.0 in trajectories[-1].vibration_frequency)
    origin = nanoseconds(trajectories[-1].origin)
    # A block boundary: a whole number of telemetry periods since time zero.
    assert (nanoseconds(status.drive_applied) - origin) % (SECOND // 100) == 0
