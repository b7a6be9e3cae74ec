"""Reports come every second and on demand, and count since the start or since the last full one."""

import pytest
import rclpy
from rclpy.parameter import Parameter

from rpud_sim.ros.drill.account import Account
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.namesakes import Namesakes
from rpud_sim.ros.drill.pacing import Pacer
from rpud_sim.ros.drill.parameters import Settings
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

SECOND = 1_000_000_000
MILLISECOND = 1_000_000


class Drill:
    """What an account is kept of, and the account."""

    def __init__(self, node):
        self.node = node
        self.inbox = Inbox(node.get_logger())
        self.outputs = DrillPublishers(node, Settings())
        self.simulation = Simulation(Parameters())
        self.control = Control(self.simulation.applied, 0.0, 0.5)
        self.pacer = Pacer(100)
        self.account = Account(node, Settings(), self.outputs, self.inbox, Namesakes(node))

    def advance(self, time):
        block = self.simulation.advance_to(time)
        self.account.add(block)
        self.pacer.finish(time)
        return block

    def report(self):
        self.account.report("running", self.simulation, self.control, self.pacer)
        return self.account.last


@pytest.fixture
def drill():
    rclpy.init()
    node = rclpy.create_node("drill_node", namespace="/rpud")
    yield Drill(node)
    node.destroy_node()
    rclpy.try_shutdown()


def figures(*blocks):
    statistics = Statistics()
    for block in blocks:
        statistics.add(block)
    return statistics.figures()


def test_the_first_report_comes_before_the_start(drill):
    assert drill.account.last is None
    assert not drill.account.refused_more()
    drill.account.report("inactive", drill.simulation, drill.control)
    report = drill.account.last
    assert (report.state, report.time) == ("inactive", 0)
    assert report.timing.blocks == 0
    assert drill.account.refused_more() is False


def test_a_report_tells_of_the_drill(drill):
    block = drill.advance(SECOND)
    drill.control.take(WeightOnBit(30.0), drill.simulation)
    report = drill.report()
    assert report.time == SECOND
    assert report.impacts == drill.simulation.impact_count >= len(block.impacts) > 0
    assert report.applied.weight_on_bit == WeightOnBit(30.0)
    assert report.regime == "drilling"
    assert report.timing.blocks == 1
    assert report.figures == figures(block)
    assert (report.commanders, report.messages_dropped) == (0, 0)


def test_figures_are_those_since_the_full_report_before_and_totals_those_of_all(drill):
    first = drill.advance(SECOND)
    assert drill.account.due()
    assert drill.report().figures == figures(first)
    assert not drill.account.due()
    second = drill.advance(2 * SECOND)
    # On demand, before the second is over: nothing new to average, but the present state.
    report = drill.report()
    assert report.figures == figures(first)
    assert report.timing.blocks == 1
    assert report.time == 2 * SECOND
    drill.account.finish()
    assert drill.account.due()
    report = drill.report()
    assert report.figures == figures(second)
    assert report.timing.blocks == 2
    third = drill.advance(3 * SECOND)
    totals = drill.account.totals.figures()
    expected = figures(first, second, third)
    assert totals == pytest.approx(expected)


def test_commands_are_counted_and_refusals_call_for_a_report(drill):
    drill.report()
    drill.inbox.accept(WeightOnBit(1.0))
    drill.inbox.take()
    assert not drill.account.refused_more()
    drill.inbox.refuse("for a reason")
    assert drill.account.refused_more()
    report = drill.report()
    assert (report.commands_accepted, report.commands_rejected) == (1, 1)
    assert not drill.account.refused_more()


def test_a_new_beginning_counts_from_zero(drill):
    drill.advance(SECOND)
    drill.report()
    drill.inbox.refuse("for a reason")
    drill.account.begin()
    assert drill.account.due()
    assert drill.account.totals.figures()["events"] == 0
    assert drill.report().commands_rejected == 0


def test_lost_commands_are_told(drill):
    drill.control.set(0.1, 0.1)
    drill.advance(SECOND)
    drill.control.act(drill.simulation)
    report = drill.report()
    assert report.commands_lost
    assert report.applied.weight_on_bit == WeightOnBit(0.0)


def test_commanders_are_counted_on_the_topic_that_has_most(drill):
    from rpud_msgs.msg import Drive
    from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage

    publishers = [
        drill.node.create_publisher(WeightOnBitMessage, "command/weight_on_bit", 1),
        drill.node.create_publisher(WeightOnBitMessage, "command/weight_on_bit", 1),
        drill.node.create_publisher(Drive, "command/drive", 1),
    ]
    assert drill.report().commanders == 2
    for publisher in publishers:
        drill.node.destroy_publisher(publisher)


def test_commanders_of_a_remapped_topic_are_counted():
    from rpud_msgs.msg import Drive

    rclpy.init()
    node = rclpy.create_node(
        "drill_node",
        namespace="/rpud",
        cli_args=["--ros-args", "-r", "command/drive:=/arm/drive"],
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )
    try:
        drill = Drill(node)
        publisher = node.create_publisher(Drive, "/arm/drive", 1)
        assert drill.report().commanders == 1
        node.destroy_publisher(publisher)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
