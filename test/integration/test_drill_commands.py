"""Commands of a plain rclpy client to a drill in another process."""

import math
import re

import pytest
from drill_client import SECOND, nanoseconds, stamps, steps
from rpud_msgs.msg import Drive, WeightOnBit


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
