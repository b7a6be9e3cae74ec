"""The command watchdog: commands that stop arriving, arrive late, or come from two sides."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from drill_client import stamps
from rpud_msgs.msg import WeightOnBit


@pytest.fixture(scope="module")
def drill(start_module_drill):
    return start_module_drill(
        "/watched",
        start_paused=True,
        publish_clock=True,
        command_timeout=0.5,
        command_loss_ramp=0.4,
        # Elastic masses without a drive would bounce for ever.
        actuator_restitution=0.8,
        drill_tool_restitution=0.8,
    )


@pytest.fixture
def client(drill, connect):
    """At time zero and paused."""
    client = connect("/watched")
    client.diagnostics = client.listen("/diagnostics")
    client.begin()
    return client


def commands_diagnosed(client, level, message):
    def found():
        return any(
            (status.level, status.message) == (level, message)
            for array in client.diagnostics
            for status in array.status
            if status.name == "/watched/drill_node: commands"
        )

    client.until(found)


def test_without_commands_drive_and_weight_go_to_zero_by_a_ramp_and_come_back_with_one(client):
    impacts = client.listen("contact_force")

    def forces_since(begin):
        forces = zip(stamps(impacts), (impact.peak_force for impact in impacts), strict=True)
        return [force for stamp, force in forces if stamp >= begin and force > 1.0]

    last = client.at(client.step(0.5))
    assert (last.commands_lost, last.weight_on_bit, last.drive_voltage) == (False, 8.0, 100.0)
    last = client.at(client.step(0.1))
    assert last.commands_lost
    assert last.weight_on_bit == pytest.approx(6.0)
    assert last.drive_voltage == pytest.approx(75.0)
    last = client.at(client.step(0.2))
    assert last.weight_on_bit == pytest.approx(2.0)
    assert last.drive_enabled
    last = client.at(client.step(0.2))
    assert (last.weight_on_bit, last.drive_enabled, last.commands_lost) == (0.0, False, True)
    commands_diagnosed(client, DiagnosticStatus.ERROR, "commands are lost: the drill is made safe")
    quiet = client.step(1.0)
    client.at(client.step(1.0))
    client.until(lambda: impacts)
    # What is left dies away: a mass at rest weighs 0.05 N.
    assert forces_since(quiet) == []
    client.diagnostics.clear()
    client.command(WeightOnBit(force=12.0))
    client.until(lambda: not client.status[-1].commands_lost)
    last = client.status[-1]
    assert (last.weight_on_bit, last.drive_enabled, last.drive_voltage) == (12.0, True, 100.0)
    commands_diagnosed(client, DiagnosticStatus.OK, "0 refused")
    client.step(0.5)
    client.until(lambda: len(forces_since(quiet)) > 50)
