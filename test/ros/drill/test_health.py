"""Reports come every second and on demand; status and diagnostics say how the drill is."""

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import Timing
from support import until

from rpud_sim.ros.drill.commands import Inbox, result_of
from rpud_sim.ros.drill.health import StatusReporter, diagnose
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.timeline import Pacer
from rpud_sim.ros.graph import filled
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Settings, to_configuration
from rpud_sim.simulation.fields import CommandCounts
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run

NO_OTHERS = SimpleNamespace(count=lambda: 0)  # of the same name
SECOND = 1_000_000_000
MILLISECOND = 1_000_000
OK, WARN, ERROR = (level[0] for level in (DiagnosticStatus.OK, DiagnosticStatus.WARN, b"\2"))
GIVEN = result_of("weight_on_bit")
MEASURED = {
    "lag": 0.0,
    "lateness_max": 0.003,
    "duplicates": 0,
    "blocks": 300,
    "messages_dropped": 0,
    "journal_dropped": 0,
}


def ran(milliseconds=0, *commands, **values):
    """Give a run with these parameters after a time under these commands."""
    run = Run(Plan(Beginning(Settings(to_configuration(values)))))
    run.begin(0)
    for command in commands:
        run.simulation.apply(command)
    list(run.advance_to(milliseconds * MILLISECOND))
    return run


def diagnosed(run, part, period=0.01, **changes):
    """Give level, text and values of a part of the diagnostics of a run."""
    status = run.status("running", CommandCounts(commands_rejected=7)).fields
    entries = diagnose(run, {**run.power().fields, **status, **MEASURED, **changes}, period)
    entry = next(entry for entry in entries if entry["name"] == part)
    return entry["level"], entry["message"], {v["key"]: v["value"] for v in entry["values"]}


@pytest.mark.parametrize(
    ("part", "changes", "level", "text"),
    [
        ("timing", {}, OK, "on time"),
        ("timing", {"lateness_max": 0.0101}, WARN, "a block was 0.010 s late"),
        ("timing", {"lateness_max": 0.0101, "period": 0.1}, OK, "on time"),
        ("timing", {"lateness_max": 2.0, "lag": 1.5}, ERROR, "simulation time lags 1.500 s behind"),
        ("commands", {}, OK, "7 rejected"),
        ("commands", {"commanders": 2}, WARN, "2 publishers send commands"),
        ("commands", {"commanders": 2, "commands_discarded": 3}, WARN, "3 discarded"),
        (
            "commands",
            {"commands_lost": True},
            ERROR,
            "commands are lost: drive and weight on bit are ramped to zero",
        ),
        ("drill", {}, OK, "running"),
        ("drill", {"duplicates": 1, "active_faults": 2}, WARN, "2 nodes have this name"),
        ("drill", {"active_faults": 2}, WARN, "2 faults injected"),
        ("messages", {}, OK, "none dropped"),
        ("messages", {"messages_dropped": 4}, WARN, "4 dropped"),
        (
            *("messages", {"journal_dropped": 500}, WARN),
            "the first 500 entries of the journal are dropped",
        ),
    ],
)
def test_the_diagnostics_name_what_is_worst(part, changes, level, text):
    assert diagnosed(ran(), part, **changes)[:2] == (level, text)


class Drill:
    """A run, its reporter, and what that publishes."""

    def __init__(self, node):
        self.node = node
        self.inbox = Inbox(node.get_logger())
        self.outputs = DrillPublishers(node, publish_clock=False)
        self.reporter = StatusReporter(node, 100, self.outputs, self.inbox, NO_OTHERS)
        self.blocks, self.diagnostics = [], []
        self.run = Run(
            Plan(Beginning(Settings(telemetry_rate=1, block_duration=1.0))), on_block=self.add
        )
        self.pacer = Pacer(100)
        send = self.outputs._send
        self.outputs._send = lambda *message: self.sent(*message) or send(*message)

    def subscribe_to_diagnostics(self):
        self.node.create_subscription(DiagnosticArray, "/diagnostics", print, 10)
        until(lambda: self.outputs.diagnosed)

    def sent(self, name, message):
        if name == "/diagnostics":
            self.diagnostics.append(deserialize_message(message, DiagnosticArray))

    def add(self, block):
        self.blocks.append(block)
        self.reporter.add(block)

    def advance(self, seconds):
        list(self.run.advance_to(seconds * SECOND))
        self.pacer.finish(seconds * SECOND)
        return figures(self.blocks[-1])

    def report(self):
        self.reporter.report("running", self.run, self.pacer)
        return self.reporter.last


@pytest.fixture
def drill(drill_node):
    return Drill(drill_node)


def figures(*blocks):
    statistics = Metrics()
    for block in blocks:
        statistics.add(block)
    return statistics.values()


def test_status_and_diagnostics_tell_of_the_drill(drill):
    drill.subscribe_to_diagnostics()
    assert (drill.reporter.last, drill.reporter.refused_more()) == (None, False)
    first = drill.advance(1)
    drill.run.apply(WeightOnBit(30.0))
    drill.run.apply(Drive(False, 80.0, 17000.0))
    drill.inbox.refuse_request("there is no fault 9 to clear")
    report = drill.report()
    status = report.status
    assert (report.time, report.figures) == (SECOND, first)
    assert status["impacts"] == drill.run.simulation.impact_count > 0
    assert (report.requests_refused, report.last_refusal) == (1, "there is no fault 9 to clear")
    assert drill.diagnostics == []  # they have time
    for _ in range(2):
        drill.reporter.publish_diagnostics()
    [message] = drill.diagnostics
    parts = {entry.name: entry for entry in message.status}
    assert list(parts) == [
        f"/rpud/drill_node: {name}" for name in ("timing", "commands", "drill", "messages")
    ]
    values = {pair.key: pair.value for entry in message.status for pair in entry.values}
    expected = {
        "blocks": "1",
        "scheduling": "time-sharing",
        "lateness_p99.9 [s]": "0",
        "command_delay_max [s]": "0",
        "requests_refused": "1",
        "last_refusal": "there is no fault 9 to clear",
        "weight_on_bit [N]": "30",
        "drive_enabled": "False",
        "drive_frequency [Hz]": "17000",
        "commanders": "0",
        "regime": "drilling",
        "impacts": str(status["impacts"]),
        "vibration_amplitude [m]": f"{status['vibration_amplitude']:g}",
        "actuator_temperature [degC]": "20",
    }
    assert {key: values[key] for key in expected} == expected
    # Nothing that this drill does not have.
    assert not {"feed_rate [m/s]", "depth [m]", "coupling_power [W]"} & values.keys()
    assert {*filled(Timing(), report.timing).get_fields_and_field_types()} == {*report.timing}


def test_without_a_subscriber_there_are_no_diagnostics(drill):
    drill.advance(1)
    drill.report()
    drill.reporter.publish_diagnostics()
    assert drill.diagnostics == []


def test_figures_are_those_since_the_full_report_before_and_totals_those_of_all(drill):
    first = drill.advance(1)
    assert drill.reporter.due()
    assert drill.report().figures == first
    assert not drill.reporter.due()
    second = drill.advance(2)
    # On demand, before the second is over: nothing new to average, but the present state.
    report = drill.report()
    assert (report.figures, report.time) == (first, 2 * SECOND)
    drill.reporter.end_period()
    assert drill.report().figures == second
    drill.advance(3)
    assert drill.reporter.totals.values() == pytest.approx(figures(*drill.blocks))


def test_commands_are_counted_and_refusals_call_for_a_report(drill):
    drill.report()
    drill.inbox.accept(WeightOnBit(1.0), GIVEN)
    drill.inbox.drain(id)
    assert not drill.reporter.refused_more()
    drill.inbox.refuse(GIVEN, "for a reason")
    assert drill.reporter.refused_more()
    report = drill.report()
    assert (report.status["commands_accepted"], report.status["commands_rejected"]) == (1, 1)
    assert not drill.reporter.refused_more()
