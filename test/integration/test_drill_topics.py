"""What plain rclpy clients hear of a drill in another process."""

import time

import numpy as np
import pytest
from drill_client import SECOND, TELEMETRY, nanoseconds, stamps, steps
from numpy.testing import assert_allclose
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rpud_msgs.msg import Result, Status
from trajectories import arrays_of, rebuild


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
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=-1.0)
    request = SetParameters.Request(parameters=[Parameter(name="weight_on_bit", value=value)])
    [result] = client.call(SetParameters, "/listened/drill_node/set_parameters", request).results
    assert not result.successful
    client.until(lambda: latest("requests_refused") == str(before + 2))
    assert latest("last_refusal") == result.reason
    assert client.reset(8).result != Result.RESULT_OK
    client.until(lambda: latest("requests_refused") == str(before + 3))
    assert latest("last_refusal") == "scope 8 is unknown"


def test_streams_have_no_gap_and_rebuild_each_other_at_rates_that_do_not_divide(
    start_drill, connect
):
    rate = 44100
    rates = {"telemetry_rate": 30, "sample_rate": rate, "block_duration": 0.1}
    start_drill("/streams", weight_on_bit=20, **rates)
    client = connect("/streams")
    waveforms, trajectories = client.listen("waveform"), client.listen("trajectory")
    planes = client.listen("nodal_plane")
    client.until(lambda: len(waveforms) >= 8 and len(trajectories) >= 9)
    origin = nanoseconds(trajectories[0].origin)

    following = steps([message.sequence for message in waveforms])
    assert following == [len(message.reacting_force) for message in waveforms[:-1]]
    assert set(following) == {rate // 10}
    for message in waveforms:
        assert message.sample_period == 1.0 / rate
        assert stamps([message]) == [origin + message.sequence * SECOND // rate]

    following = steps([message.sequence for message in trajectories])
    assert following == [len(message.duration) for message in trajectories[:-1]]
    arrays = arrays_of(trajectories)
    starts = arrays["start_seconds"] + arrays["start_fraction"]
    assert_allclose(np.diff(starts), arrays["duration"][:-1], atol=1e-14)
    for message in trajectories:
        exact = origin + (message.start_seconds[0] + message.start_fraction[0]) * SECOND
        assert abs(stamps([message])[0] - exact) <= 1000  # as a float cannot tell it better

    first = np.ceil(starts[0] * rate)
    compared = 0
    for message in waveforms:
        number = message.sequence + np.arange(len(message.reacting_force))
        told = (number >= first) & (number / rate < starts[-1])
        if not told.any():
            continue
        compared += told.sum()
        number = number[told]
        expected = rebuild(arrays, number // rate, number % rate / rate)
        for name, tolerance in {
            "nodal_plane_position": 1e-13,
            "actuator_position": 1e-13,
            "free_mass_position": 1e-13,
            "drill_tool_displacement": 1e-13,
            "contact_force": 1e-3,
            "reacting_force": 1e-8,
        }.items():
            found = np.array(getattr(message, name))[told]
            assert_allclose(found, expected[name], rtol=1e-9, atol=tolerance, err_msg=name)
    assert compared > 5 * rate // 10
    # Periods of 33333333.3 ns do not add up to a drift.
    times = [stamp - origin for stamp in stamps(planes)]
    numbers = [round(at * 30 / SECOND) for at in times]
    assert set(steps(numbers)) == {1}
    assert times == [number * SECOND // 30 for number in numbers]
