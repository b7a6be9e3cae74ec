"""Reports come every second and on demand, and count since the start or since the last full one."""

import pytest
import rclpy
from rpud_msgs.msg import CommandResult, Drive
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage
from support import until

from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.report import StatusReporter
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.statistics import Statistics

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

GIVEN = CommandResult(kind="weight_on_bit")


class Drill:
    """What an reporter is kept of, and the reporter."""

    def __init__(self, node):
        self.node = node
        self.inbox = Inbox(node.get_logger())
        self.outputs = DrillPublishers(node, publish_clock=False)
        self.blocks = []
        self.reporter = StatusReporter(node, 100, self.outputs, self.inbox, DuplicateNodes(node))
        self.run = Run(Beginning(Settings(telemetry_rate=1, block_duration=1.0)), on_block=self.add)
        self.pacer = Pacer(100)

    def add(self, block):
        self.blocks.append(block)
        self.reporter.add(block)

    def advance(self, time):
        list(self.run.advance_to(time))
        self.pacer.finish(time)
        return self.blocks[-1]

    def report(self):
        self.reporter.report("running", self.run, self.pacer)
        return self.reporter.last


@pytest.fixture
def drill(drill_node):
    return Drill(drill_node)


def figures(*blocks):
    statistics = Statistics()
    for block in blocks:
        statistics.add(block)
    return statistics.figures()


def test_the_first_report_comes_before_the_start(drill):
    assert drill.reporter.last is None
    assert not drill.reporter.refused_more()
    drill.reporter.report("inactive", drill.run, drill.pacer)
    report = drill.reporter.last
    assert (report.status["state"], report.time) == ("inactive", 0)
    assert report.timing.blocks == 0
    assert drill.reporter.refused_more() is False


def test_a_report_tells_of_the_drill(drill):
    block = drill.advance(SECOND)
    drill.run.control.apply(WeightOnBit(30.0))
    report = drill.report()
    assert report.time == SECOND
    assert report.status["impacts"] == drill.run.simulation.impact_count >= len(block.impacts) > 0
    assert report.status["weight_on_bit"] == 30.0
    assert report.status["regime"] == "drilling"
    assert report.timing.blocks == 1
    assert report.figures == figures(block)
    assert (report.status["commanders"], report.status["messages_dropped"]) == (0, 0)


def test_figures_are_those_since_the_full_report_before_and_totals_those_of_all(drill):
    first = drill.advance(SECOND)
    assert drill.reporter.due()
    assert drill.report().figures == figures(first)
    assert not drill.reporter.due()
    second = drill.advance(2 * SECOND)
    # On demand, before the second is over: nothing new to average, but the present state.
    report = drill.report()
    assert report.figures == figures(first)
    assert report.timing.blocks == 1
    assert report.time == 2 * SECOND
    drill.reporter.end_period()
    assert drill.reporter.due()
    report = drill.report()
    assert report.figures == figures(second)
    assert report.timing.blocks == 2
    third = drill.advance(3 * SECOND)
    totals = drill.reporter.totals.figures()
    expected = figures(first, second, third)
    assert totals == pytest.approx(expected)


def test_commands_are_counted_and_refusals_call_for_a_report(drill):
    drill.report()
    drill.inbox.accept(WeightOnBit(1.0), GIVEN)
    drill.inbox.drain()
    assert not drill.reporter.refused_more()
    drill.inbox.refuse(GIVEN, "for a reason")
    assert drill.reporter.refused_more()
    report = drill.report()
    assert (report.status["commands_accepted"], report.status["commands_rejected"]) == (1, 1)
    assert not drill.reporter.refused_more()


def test_a_new_beginning_counts_from_zero(drill):
    drill.advance(SECOND)
    drill.report()
    drill.inbox.refuse(GIVEN, "for a reason")
    drill.reporter.begin()
    assert drill.reporter.due()
    assert drill.reporter.totals.figures()["events"] == 0
    assert drill.report().status["commands_rejected"] == 0


def test_lost_commands_are_told(drill):
    drill.run.control.set(0.1, 0.1)
    drill.advance(SECOND)
    drill.run.control.act()
    report = drill.report()
    assert report.status["commands_lost"]
    assert report.status["weight_on_bit"] == 0.0


def test_commanders_are_counted_on_the_topic_that_has_most(drill):
    for kind, topic in (
        (WeightOnBitMessage, "weight_on_bit"),
        (WeightOnBitMessage, "weight_on_bit"),
        (Drive, "drive"),
    ):
        drill.node.create_publisher(kind, f"command/{topic}", 1)
    assert drill.report().status["commanders"] == 2


def test_publishers_are_counted_for_each_command(drill):
    for kind, topic in ((WeightOnBitMessage, "weight_on_bit"), (Drive, "drive")):
        drill.node.create_subscription(kind, f"command/{topic}", lambda _: None, 1)
    reporter = Drill(drill.node).reporter
    assert reporter.publishers_heard() == {"command/weight_on_bit": 0, "command/drive": 0}
    drill.node.create_publisher(Drive, "command/drive", 1)
    until(lambda: reporter.publishers_heard() == {"command/weight_on_bit": 0, "command/drive": 1})


def test_commanders_of_a_remapped_topic_are_counted(nodes):
    remapped = ["--ros-args", "-r", "command/drive:=/arm/drive"]
    nodes.append(rclpy.create_node("drill_node", namespace="/rpud", cli_args=remapped))
    nodes[-1].create_publisher(Drive, "/arm/drive", 1)
    assert Drill(nodes[-1]).report().status["commanders"] == 1
