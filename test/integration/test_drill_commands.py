"""Commands of a plain rclpy client to a drill in another process."""

import pytest
from drill_client import SECOND, nanoseconds
from rpud_msgs.msg import Drive


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill("/commanded")


@pytest.fixture
def client(drill, connect):
    client = connect("/commanded")
    client.until(lambda: client.status)
    return client


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
