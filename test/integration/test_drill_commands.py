"""Commands of a plain rclpy client to a drill in another process."""

import math
import re

import numpy as np
import pytest
from drill_client import SECOND, nanoseconds, stamps, steps
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rpud_msgs.msg import Drive, WeightOnBit

from rpud_sim.model.parameters import NAMES
from rpud_sim.simulation.configuration import NODE_NAMES


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/commanded")


@pytest.fixture
def client(drill, connect):
    client = connect("/commanded")
    client.until(lambda: client.status)
    return client


@pytest.fixture
def settle(client):
    """Put the drill back to 10 N and full drive, and hear that it took both."""

    def send():
        client.command(WeightOnBit(force=10.0))
        client.command(Drive(enabled=True, voltage=100.0, frequency=16000.0))

        def settled():
            last = client.status[-1]
            return (last.weight_on_bit, last.drive_voltage, last.drive_enabled) == (10, 100, True)

        client.until(settled)

    return send


def applied(status):
    """Give all that a refused command must not change."""
    return (
        status.weight_on_bit,
        status.weight_on_bit_applied,
        status.drive_enabled,
        status.drive_voltage,
        status.drive_frequency,
        status.drive_applied,
        status.commands_accepted,
    )


@pytest.mark.extended
def test_more_weight_on_bit_raises_the_mean_reacting_force_within_two_seconds(client, settle):
    settle()
    heard = client.listen("waveform")

    def mean(begin, end):
        """Give the mean between two stamps, which are whole blocks."""
        force = [
            message.reacting_force
            for message, stamp in zip(heard, stamps(heard), strict=True)
            if begin <= stamp < end
        ]
        return np.mean(np.concatenate(force))

    client.until(lambda: heard)
    began = stamps(heard)[0]
    client.until(lambda: stamps(heard[-1:])[0] >= began + SECOND)
    client.command(WeightOnBit(force=30.0))
    status = client.until(
        lambda: next((it for it in client.status if it.weight_on_bit == 30.0), None)
    )
    changed = nanoseconds(status.weight_on_bit_applied)
    assert nanoseconds(status.header.stamp) == changed > nanoseconds(status.drive_applied)
    client.until(lambda: stamps(heard[-1:])[0] >= changed + 2 * SECOND)
    before = mean(began, changed)
    after = mean(changed, changed + 2 * SECOND)
    # 16 N more on average; nowhere near as much by chance.
    assert after > before + 8.0


@pytest.mark.parametrize(
    ("force", "said"), [(math.nan, "nan"), (math.inf, "inf"), (-1.0, "-1"), (1e9, "1e+09")]
)
def test_a_weight_on_bit_that_cannot_be_is_refused_counted_and_logged(client, drill, force, said):
    before = client.status[-1]
    client.command(WeightOnBit(force=force))
    client.until(lambda: client.status[-1].commands_rejected == before.commands_rejected + 1)
    assert applied(client.status[-1]) == applied(before)
    drill.wait_for_line(
        re.escape(f"command refused: weight_on_bit = {said} N is outside its range [0, 1000] N")
    )


@pytest.mark.parametrize(
    ("drive", "complaint"),
    [
        ({"voltage": math.nan, "frequency": 16e3}, "drive voltage = nan V is outside its range"),
        ({"voltage": -5.0, "frequency": 16e3}, "drive voltage = -5 V is outside its range"),
        ({"voltage": 100.0, "frequency": 0.0}, "drive frequency = 0 Hz is outside its range"),
        ({"voltage": 100.0, "frequency": 1e9}, "drive frequency = 1e+09 Hz is outside its range"),
    ],
)
def test_a_drive_that_cannot_be_is_refused_and_changes_nothing(client, drill, drive, complaint):
    before = client.status[-1]
    client.command(Drive(enabled=True, **drive))
    client.until(lambda: client.status[-1].commands_rejected == before.commands_rejected + 1)
    assert applied(client.status[-1]) == applied(before)
    drill.wait_for_line(re.escape(f"command refused: {complaint}"))


def test_refused_commands_leave_the_drill_at_work(client, settle):
    settle()
    impacts = client.listen("contact_force")
    before = client.status[-1].commands_rejected
    for force in (math.nan, -1.0, 1e9, math.inf) * 20:
        client.command(WeightOnBit(force=force))
    client.until(lambda: client.status[-1].commands_rejected == before + 80)
    heard = len(impacts)
    client.until(lambda: len(impacts) >= heard + 100)
    assert set(steps([message.sequence for message in impacts])) == {1}


def test_impacts_stop_with_the_drive_and_begin_again_with_it(client, settle):
    settle()
    impacts, waveforms = client.listen("contact_force"), client.listen("waveform")
    client.until(lambda: len(impacts) >= 20)
    client.command(Drive(enabled=False))
    off = client.until(lambda: next((it for it in client.status if not it.drive_enabled), None))
    # Zeros leave voltage and frequency as they are.
    assert (off.drive_voltage, off.drive_frequency) == (100.0, 16000.0)
    stopped = nanoseconds(off.drive_applied)
    client.until(lambda: stamps(client.status[-1:])[0] >= stopped + int(1.2 * SECOND))
    client.until(lambda: stamps(waveforms[-1:])[0] > stopped + SECOND)
    quiet = client.status[-1].impacts
    client.until(lambda: impacts[-1].sequence + 1 >= quiet)
    last = [stamp for stamp in stamps(impacts) if stamp > stopped + SECOND // 2]
    assert last == []
    # The actuator stands still: only the suspension moves what is left of it.
    assert waveforms[-1].actuator_position == pytest.approx(
        waveforms[-1].nodal_plane_position, abs=1e-15
    )
    assert quiet == impacts[-1].sequence + 1
    client.command(Drive(enabled=True, voltage=100.0, frequency=16000.0))
    client.until(lambda: client.status[-1].drive_enabled)
    client.until(lambda: impacts[-1].sequence >= quiet + 20)
    assert set(steps([message.sequence for message in impacts])) == {1}


def test_applied_commands_come_back_with_the_time_at_which_they_took_effect(client):
    client.command(Drive(enabled=True, voltage=80.0, frequency=17000.0))
    status = client.until(
        lambda: next((it for it in client.status if it.drive_frequency == 17000.0), None)
    )
    assert status.drive_voltage == 80.0
    at = nanoseconds(status.drive_applied)
    trajectories = client.listen("trajectory")
    client.until(lambda: trajectories and 17000.0 in trajectories[-1].vibration_frequency)
    origin = nanoseconds(trajectories[-1].origin)
    # A block boundary: a whole number of telemetry periods since time zero.
    assert (at - origin) % (SECOND // 100) == 0


def test_the_command_s_own_stamp_is_not_needed(client):
    before = client.status[-1].commands_accepted
    message = WeightOnBit(force=11.0)
    message.header.stamp.sec = 5  # long ago
    client.command(message)
    client.until(lambda: client.status[-1].weight_on_bit == 11.0)
    assert client.status[-1].commands_accepted == before + 1


def test_parameters_are_listed_described_and_given_as_ros2_param_does(client):
    node = "/commanded/drill_node"
    listed = client.call(
        ListParameters, f"{node}/list_parameters", ListParameters.Request()
    ).result.names
    assert {*NAMES, *NODE_NAMES} <= set(listed)
    request = DescribeParameters.Request(names=["weight_on_bit"])
    [described] = client.call(
        DescribeParameters, f"{node}/describe_parameters", request
    ).descriptors
    assert described.type == ParameterType.PARAMETER_DOUBLE
    assert described.description == "weight on bit, preload of the load spring, W [N]"
    assert described.additional_constraints == "in [0, 1000] N"
    assert described.floating_point_range[0].to_value == 1000.0
    assert described.read_only
    request = GetParameters.Request(names=["weight_on_bit", "regime"])
    values = client.call(GetParameters, f"{node}/get_parameters", request).values
    assert (values[0].double_value, values[1].string_value) == (8.0, "drilling")


def test_a_parameter_cannot_be_set_and_the_reason_is_said(client):
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=20.0)
    request = SetParameters.Request(parameters=[Parameter(name="weight_on_bit", value=value)])
    before = client.status[-1].weight_on_bit
    [result] = client.call(SetParameters, "/commanded/drill_node/set_parameters", request).results
    assert not result.successful
    assert "read-only" in result.reason
    count = len(client.status)
    client.until(lambda: len(client.status) > count)
    assert client.status[-1].weight_on_bit == before
