"""Status and diagnostics say what a report says."""

import dataclasses

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message

from rpud_sim.ros.drill.pacing import Timing
from rpud_sim.ros.drill.report import Report, report_to_diagnostics, report_to_status
from rpud_sim.simulation.commands import Applied, Drive, WeightOnBit

SECOND = 1_000_000_000
ORIGIN = 1_700_000_000 * SECOND + 5
ON_TIME = Timing(
    blocks=300,
    deadlines_missed=4,
    lateness=0.0002,
    lateness_max=0.003,
    lateness_p50=0.0001,
    lateness_p99=0.0011,
    lateness_p999=0.0025,
    lag=0.0,
    real_time_factor=0.9998,
)
REPORT = Report(
    state="running",
    time=3 * SECOND,
    regime="drilling",
    applied=Applied(WeightOnBit(30.0), 2 * SECOND, Drive(False, 80.0, 17000.0), SECOND),
    impacts=1234,
    commands_accepted=2,
    commands_rejected=7,
    requests_refused=3,
    last_refusal="there is no fault 9 to clear",
    commands_lost=False,
    commanders=1,
    namesakes=0,
    messages_dropped=1,
    vibration_amplitude=28e-6,
    resonance_frequency=16010.0,
    actuator_temperature=300.5,
    electrical_power=12.5,
    depth=0.003,
    penetration_rate=1e-5,
    active_faults=0,
    scheduling="real-time priority 10",
    timing=ON_TIME,
    figures={},
)


def nanoseconds(time):
    return time.sec * SECOND + time.nanosec


def late(**changes):
    return dataclasses.replace(REPORT, timing=dataclasses.replace(ON_TIME, **changes))


def diagnostics(report, telemetry_rate=100):
    return report_to_diagnostics(report, "/rpud/drill_node", Time(sec=9), telemetry_rate)


def test_the_status_says_every_figure():
    status = report_to_status(REPORT, ORIGIN)
    assert nanoseconds(status.header.stamp) == ORIGIN + 3 * SECOND
    assert nanoseconds(status.weight_on_bit_applied) == ORIGIN + 2 * SECOND
    assert nanoseconds(status.drive_applied) == ORIGIN + SECOND
    expected = {
        "state": "running",
        "regime": "drilling",
        "weight_on_bit": 30.0,
        "drive_enabled": False,
        "drive_voltage": 80.0,
        "drive_frequency": 17000.0,
        "impacts": 1234,
        "commands_accepted": 2,
        "commands_rejected": 7,
        "deadlines_missed": 4,
        "messages_dropped": 1,
        "commands_lost": False,
        "commanders": 1,
        "vibration_amplitude": 28e-6,
        "resonance_frequency": 16010.0,
        "actuator_temperature": 300.5,
        "electrical_power": 12.5,
        "depth": 0.003,
        "penetration_rate": 1e-5,
        "active_faults": 0,
        "real_time_factor": 0.9998,
        "lateness_max": 0.003,
        "lag": 0.0,
    }
    assert {name: getattr(status, name) for name in expected} == expected
    times = {"header", "weight_on_bit_applied", "drive_applied"}
    assert set(status.get_fields_and_field_types()) == {*expected, *times}
    assert status.state == status.STATE_RUNNING
    assert status.regime == status.REGIME_DRILLING
    serialize_message(status)


@pytest.mark.parametrize(
    ("report", "level", "text"),
    [
        (REPORT, DiagnosticStatus.OK, "on time"),
        (late(lateness_max=0.0101), DiagnosticStatus.WARN, "a block was 0.010 s late"),
        (late(lag=1.5), DiagnosticStatus.ERROR, "simulation time lags 1.500 s behind"),
    ],
)
def test_the_level_of_the_timing_is_that_of_the_lateness(report, level, text):
    message = diagnostics(report)
    assert message.status[0].level == level
    assert message.status[0].message == text


def test_what_is_late_depends_on_the_period():
    report = late(lateness_max=0.05)
    assert diagnostics(report, 10).status[0].level == DiagnosticStatus.OK
    assert diagnostics(report, 1000).status[0].level == DiagnosticStatus.WARN


def test_the_diagnostics_have_names_and_values():
    message = diagnostics(REPORT)
    assert message.header.stamp.sec == 9
    timing, commands, drill = message.status
    assert timing.name == "/rpud/drill_node: timing"
    assert commands.name == "/rpud/drill_node: commands"
    assert commands.message == "7 refused"
    assert drill.name == "/rpud/drill_node: drill"
    assert (drill.level, drill.message) == (DiagnosticStatus.OK, "running")
    values = {pair.key: pair.value for status in message.status for pair in status.values}
    assert values["deadlines_missed"] == "4"
    assert values["requests_refused"] == "3"
    assert values["last_refusal"] == "there is no fault 9 to clear"
    assert values["real_time_factor"] == "0.9998"
    assert values["lateness_max [s]"] == "0.003000"
    assert values["scheduling"] == "real-time priority 10"
    assert values["lateness_p50 [s]"] == "0.000100"
    assert values["lateness_p99 [s]"] == "0.001100"
    assert values["lateness_p99.9 [s]"] == "0.002500"
    assert values["messages_dropped"] == "1"
    assert values["commands_accepted"] == "2"
    assert values["weight_on_bit [N]"] == "30"
    assert values["drive_enabled"] == "False"
    assert values["drive_frequency [Hz]"] == "17000"
    assert values["commanders"] == "1"
    assert values["regime"] == "drilling"
    assert values["impacts"] == "1234"
    assert values["vibration_amplitude [m]"] == "2.8e-05"
    assert values["actuator_temperature [K]"] == "300.5"
    assert values["depth [m]"] == "0.003"
    serialize_message(message)


@pytest.mark.parametrize(
    ("changes", "level", "text"),
    [
        ({}, DiagnosticStatus.OK, "7 refused"),
        ({"commanders": 2}, DiagnosticStatus.WARN, "2 publishers command at once"),
        (
            {"commanders": 2, "commands_lost": True},
            DiagnosticStatus.ERROR,
            "commands are lost: the drill is made safe",
        ),
    ],
)
def test_lost_commands_and_two_commanders_are_told(changes, level, text):
    commands = diagnostics(dataclasses.replace(REPORT, **changes)).status[1]
    assert (commands.level, commands.message) == (level, text)


def test_faults_that_last_are_told_with_their_number():
    drill = diagnostics(dataclasses.replace(REPORT, active_faults=2)).status[2]
    assert (drill.level, drill.message) == (DiagnosticStatus.WARN, "2 faults injected")


def test_other_nodes_of_the_same_name_are_told():
    drill = diagnostics(dataclasses.replace(REPORT, namesakes=1, active_faults=2)).status[2]
    assert (drill.level, drill.message) == (DiagnosticStatus.WARN, "2 nodes have this name")
    assert {pair.key: pair.value for pair in drill.values}["namesakes"] == "1"
