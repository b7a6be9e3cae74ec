"""Status and diagnostics say what a report says."""

import dataclasses

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import serialize_message

from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.ros.drill.pacer import Punctuality
from rpud_sim.ros.drill.report import Report, report_to_diagnostics
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings, to_configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.run import Beginning, Run

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
ORIGIN = 1_700_000_000 * SECOND + 5
ON_TIME = Punctuality(
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
COUNTS = Bookkeeping(
    commands_accepted=2,
    commands_rejected=7,
    commanders=1,
    deadlines_missed=4,
    messages_dropped=1,
    real_time_factor=0.9998,
    lateness_max=0.003,
)


def made(**counts):
    """Give the report of a run that was commanded, at 20 ms."""
    run = begun(rock_model="specific_energy")
    run.simulation.apply(WeightOnBit(30.0))
    list(run.advance_to(10 * MILLISECOND))
    run.simulation.apply(Drive(False, 80.0, 17000.0))
    list(run.advance_to(20 * MILLISECOND))
    return report_of(run, **counts)


def delays(*seconds):
    found = DelayHistogram()
    for each in seconds:
        found.add(each * SECOND)
    return found


def begun(**values):
    """Give a run with these parameters at its beginning."""
    run = Run(Beginning(Settings(to_configuration(values))))
    run.begin(ORIGIN)
    return run


def report_of(run, **counts):
    """Give the report of a run."""
    bookkeeping = dataclasses.replace(COUNTS, **counts)
    return Report(
        time=run.time,
        status=run.status("running", bookkeeping)[2],
        coupling_power=run.coupling_power,
        unloaded_amplitude=run.simulation.unloaded_amplitude,
        process=run.simulation.process,
        at_tool_length=run.simulation.at_tool_length,
        faults=run.simulation.faults.active,
        requests_refused=3,
        last_refusal="there is no fault 9 to clear",
        namesakes=0,
        scheduling="real-time priority 10",
        timing=ON_TIME,
        command_delays=delays(0.004, 0.004, 0.009, 0.0095),
        impact_delays=delays(0.005, 0.01, 0.011),
        figures={},
        published={"status": 5, "journal": 3},
        subscribers={"status": 2, "journal": 0},
        publishers={"command/drive": 1, "command/feed": 0},
        acknowledged=True,
    )


REPORT = made()


def test_steps_of_the_arm_that_lose_power_are_a_warning():
    run = begun(feed_model="arm", initial_feed=0.004)
    list(run.advance_to(100 * MILLISECOND))
    report = report_of(run)
    drill = diagnostics(report).status[2]
    values = {pair.key: pair.value for pair in drill.values}
    assert (drill.level, drill.message) == (DiagnosticStatus.OK, "running")
    assert abs(float(values["coupling_power [W]"])) < 0.05 * report.status["actuator_power"]
    power = 0.06 * report.status["actuator_power"]
    drill = diagnostics(dataclasses.replace(report, coupling_power=-power)).status[2]
    assert drill.level == DiagnosticStatus.WARN
    assert f"lose {-power:.3g} W, more than 5% of" in drill.message


@pytest.mark.parametrize(("weight", "stalled"), [(8.0, False), (30.0, True)])
def test_a_vibration_that_the_load_stalls_is_a_warning(weight, stalled):
    run = begun(
        actuator_model="resonance",
        weight_on_bit=weight,
        contact_model="printed",
        vibration_amplitude=35e-6,
    )
    list(run.advance_to(300 * MILLISECOND))
    drill = diagnostics(report_of(run)).status[2]
    assert (drill.level == DiagnosticStatus.WARN) is stalled
    assert ("less than 5% of 35 um without load" in drill.message) is stalled


def nanoseconds(time):
    return time.sec * SECOND + time.nanosec


def late(**changes):
    return dataclasses.replace(REPORT, timing=dataclasses.replace(ON_TIME, **changes))


def diagnostics(report, telemetry_rate=100):
    return report_to_diagnostics(report, "/rpud/drill_node", Time(sec=9), telemetry_rate)


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
    timing, commands, drill, messages = message.status
    assert timing.name == "/rpud/drill_node: timing"
    assert commands.name == "/rpud/drill_node: commands"
    assert commands.message == "7 refused"
    assert drill.name == "/rpud/drill_node: drill"
    assert (drill.level, drill.message) == (DiagnosticStatus.OK, "running")
    values = {pair.key: pair.value for status in message.status for pair in status.values}
    assert messages.name == "/rpud/drill_node: messages"
    assert (messages.level, messages.message) == (DiagnosticStatus.WARN, "1 dropped")
    expected = {
        "published": "status 5, journal 3",
        "subscribers": "status 2, journal 0",
        "publishers": "command/drive 1, command/feed 0",
        "acknowledged": "True",
        "deadlines_missed": "4",
        "requests_refused": "3",
        "last_refusal": "there is no fault 9 to clear",
        "real_time_factor": "0.9998",
        "lateness_max [s]": "0.003000",
        "scheduling": "real-time priority 10",
        "lateness_p50 [s]": "0.000100",
        "lateness_p99 [s]": "0.001100",
        "lateness_p99.9 [s]": "0.002500",
        "command_delay_p50 [s]": f"{REPORT.command_delays.quantile(0.5):.6f}",
        "command_delay_p99 [s]": "0.009500",
        "command_delay_max [s]": "0.009500",
        "impact_delay_max [s]": "0.011000",
        "messages_dropped": "1",
        "commands_accepted": "2",
        "weight_on_bit [N]": "30",
        "drive_enabled": "False",
        "drive_frequency [Hz]": "17000",
        "commanders": "1",
        "regime": "drilling",
        "impacts": str(REPORT.status["impacts"]),
        "vibration_amplitude [m]": f"{REPORT.status['vibration_amplitude']:g}",
        "actuator_temperature [K]": "293.15",
        "depth [m]": f"{REPORT.status['depth']:g}",
    }
    assert {key: values[key] for key in expected} == expected
    assert "0" not in (values["impacts"], values["depth [m]"])
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
    commands = diagnostics(made(**changes)).status[1]
    assert (commands.level, commands.message) == (level, text)


def test_faults_that_last_are_told_with_their_number():
    drill = diagnostics(
        dataclasses.replace(REPORT, status={**REPORT.status, "active_faults": 2})
    ).status[2]
    assert (drill.level, drill.message) == (DiagnosticStatus.WARN, "2 faults injected")


def test_a_hole_as_deep_as_the_tool_is_long_is_told():
    run = begun(rock_model="specific_energy", section_1_length=1e-6, section_2_length=1e-6)
    list(run.advance_to(200 * MILLISECOND))
    drill = diagnostics(report_of(run)).status[2]
    text = "the hole is as deep as the drill tool is long: it gets no deeper"
    assert (drill.level, drill.message) == (DiagnosticStatus.WARN, text)


ARM = {"feed_model": "arm", "initial_feed": 1e-3}
HOLE = {"strata": "sandstone"}


def values_of(run):
    """Give the values of the diagnostics of commands and drill, by key."""
    _, commands, drill, _ = diagnostics(report_of(run)).status
    return ({pair.key: pair.value for pair in each.values} for each in (commands, drill))


@pytest.mark.parametrize(
    ("feed", "expected"),
    [
        (Feed("rate", -2.5e-4), {"feed_mode": "rate", "feed_value [m/s]": "-0.00025"}),
        (Feed("position", 0.012), {"feed_mode": "position", "feed_value [m]": "0.012"}),
    ],
)
def test_on_an_arm_the_diagnostics_have_the_feed_in_force_in_the_unit_of_its_mode(feed, expected):
    run = begun(**ARM)
    run.simulation.apply(feed)
    list(run.advance_to(20 * MILLISECOND))
    commands, drill = values_of(run)
    assert {key: value for key, value in commands.items() if key.startswith("feed")} == expected
    assert "side_offset [m]" not in drill


def test_with_a_borehole_the_diagnostics_have_the_walk_of_the_bit():
    run = begun(**ARM, **HOLE)
    commands, drill = values_of(run)
    assert commands["feed_value [m/s]"] == drill["side_offset [m]"] == "0"
    run.simulation.apply(Feed("rate", 1e-3))
    run.simulation.inject(Fault("bit_walk"))
    list(run.advance_to(200 * MILLISECOND))
    walked = run.simulation.process.borehole.side_offset
    assert walked > 0.0
    _, drill = values_of(run)
    assert drill["side_offset [m]"] == f"{walked:g}"


def test_without_feed_and_borehole_the_diagnostics_have_neither():
    commands, drill = values_of(begun(rock_model="specific_energy"))
    assert not any(key.startswith("feed") for key in commands)
    assert "side_offset [m]" not in drill
