"""Status reporter: statistics of a drilling, and the reports of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

from rclpy.node import Node
from rpud_msgs.msg import CommandResults
from std_msgs.msg import Header

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.messages import nanoseconds_to_time
from rpud_sim.ros.drill.namesakes import DuplicateNodes
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import RESULTS, DrillPublishers
from rpud_sim.ros.drill.report import Report, report_to_diagnostics
from rpud_sim.simulation.block import Block, join_blocks
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.statistics import Statistics
from rpud_sim.simulation.topics import MOUNT_FRAME

REPORT_PERIOD = 1.0  # of status and diagnostics [s]
CHANGE_PERIOD = 0.05  # of reports that commands cause while time goes on, at least [s]
_BATCH_SIZE = 20  # blocks that are counted at once: one by one would take most of the time
# Topics that command the same: two publishers on one line are a mistake.
_COMMAND_TOPICS = (
    ("command/weight_on_bit",),
    ("command/drive",),
    ("command/feed", "joint_commands"),
)


class StatusReporter:
    """Statistics and reports, every second and on demand; ``telemetry_rate`` is in Hz."""

    def __init__(
        self,
        node: Node,
        telemetry_rate: int,
        publishers: DrillPublishers,
        inbox: Inbox,
        namesakes: DuplicateNodes,
    ) -> None:
        self.scheduling = "time-sharing"  # how the system schedules the pacing thread
        self._node = node
        self._telemetry_rate = telemetry_rate
        self._publishers = publishers
        self._inbox = inbox
        self._namesakes = namesakes
        self._command_topics = [
            [node.resolve_topic_name(topic) for topic in topics] for topics in _COMMAND_TOPICS
        ]
        commands = {topic for topics in _COMMAND_TOPICS for topic in topics}
        self._subscriptions = [each for each in node.subscriptions if each.topic in commands]
        self.last: Report | None = None  # the latest report, None before the first
        self._blocks: list[Block] = []
        self._impact_delays = DelayHistogram()
        self._diagnostics_wait = False
        self._rests_until = 0
        self.begin()

    @property
    def totals(self) -> Statistics:
        """Statistics since the start; to be read when the drilling has ended."""
        self._count()
        totals = Statistics()
        totals.merge(self._totals)
        totals.merge(self._interval)
        return totals

    def begin(self) -> None:
        """Count from zero."""
        self._blocks.clear()
        self._totals = Statistics()
        self._interval = Statistics()
        self._inbox.begin()
        self._impact_delays = DelayHistogram()
        self._due = 0

    def add(self, block: Block) -> None:
        self._blocks.append(block)
        if len(self._blocks) >= _BATCH_SIZE:
            self._count()

    def add_impact_delays(self, delays: Iterable[int]) -> None:
        """Add the delays of impacts from their stamps until they were published [ns]."""
        for delay in delays:
            self._impact_delays.add(delay)

    def publishers_heard(self) -> Mapping[str, int]:
        """Return the number of publishers whose commands reach the node, by topic.

        The graph names a publisher before its messages arrive.
        """
        return {each.topic: each.get_publisher_count() for each in self._subscriptions}

    def due(self) -> bool:
        """Whether it is time for a full report."""
        return time.monotonic_ns() >= self._due

    def refused_more(self) -> bool:
        """Whether commands were refused or discarded since the last report."""
        if self.last is None:
            return False
        reported = tuple(
            self.last.status[name] for name in ("commands_rejected", "commands_discarded")
        )
        return (self._inbox.rejected, self._inbox.discarded) != reported

    @property
    def rested(self) -> bool:
        """Whether the last report is long enough ago for one of changes."""
        return time.monotonic_ns() >= self._rests_until

    def end_period(self) -> None:
        """Make the next report a full one."""
        self._due = 0

    def report(self, state: str, run: Run, pacer: Pacer) -> None:
        """Publish the status, with one of its STATE constants.

        Diagnostics of it wait for ``publish_diagnostics``.
        """
        now = time.monotonic_ns()
        if self.last is None or now >= self._due:
            self.publish_diagnostics()  # one in each period, even where time is short
            self._count()
            timing, command_delays = pacer.read(), self._inbox.take_delays()
            impact_delays, self._impact_delays = self._impact_delays, DelayHistogram()
            figures = self._interval.figures()
            self._totals.merge(self._interval)
            self._interval = Statistics()
            self._due = now + round(REPORT_PERIOD * SECOND)
        else:
            timing, figures = self.last.timing, self.last.figures
            command_delays = self.last.command_delays
            impact_delays = self.last.impact_delays
        bookkeeping = Bookkeeping(
            commands_accepted=self._inbox.accepted,
            commands_rejected=self._inbox.rejected,
            commands_discarded=self._inbox.discarded,
            commands_lost=run.control.commands_lost,
            commanders=max(
                sum(map(self._node.count_publishers, topics)) for topics in self._command_topics
            ),
            deadlines_missed=timing.deadlines_missed,
            messages_dropped=self._publishers.dropped,
            real_time_factor=timing.real_time_factor,
            lateness_max=timing.lateness_max,
            lag=timing.lag,
        )
        status = run.status(state, bookkeeping)
        self._publishers.publish([status])
        self._publish_results(run.origin + run.time)
        self.last = Report(
            time=run.time,
            status=status[2],
            coupling_power=run.coupling_power,
            unloaded_amplitude=run.simulation.unloaded_amplitude,
            process=run.simulation.process,
            at_tool_length=run.simulation.at_tool_length,
            faults=run.simulation.faults.active,
            requests_refused=self._inbox.requests_refused,
            last_refusal=self._inbox.last_refusal,
            namesakes=self._namesakes.count(),
            scheduling=self.scheduling,
            timing=timing,
            command_delays=command_delays,
            impact_delays=impact_delays,
            figures=figures,
            published=self._publishers.published,
            subscribers=self._publishers.subscribers(),
            publishers=self.publishers_heard(),
            acknowledged=self._publishers.acknowledged(),
        )
        self._diagnostics_wait = True
        self._rests_until = time.monotonic_ns() + round(CHANGE_PERIOD * SECOND)

    def publish_diagnostics(self) -> None:
        """Publish the diagnostics of the latest report, unless that was done."""
        if not self._diagnostics_wait or self.last is None:
            return
        self._diagnostics_wait = False
        diagnostics = report_to_diagnostics(
            self.last,
            self._node.get_fully_qualified_name(),
            self._node.get_clock().now().to_msg(),
            self._telemetry_rate,
        )
        self._publishers.publish_message("/diagnostics", diagnostics)

    def _publish_results(self, stamp: int) -> None:
        if (results := self._inbox.take_results()) is None:
            return
        former, found = results
        message = CommandResults(
            header=Header(stamp=nanoseconds_to_time(stamp), frame_id=MOUNT_FRAME),
            results=[*former, *found],
            former=len(former),
            status=self._publishers.published["status"],
        )
        self._publishers.publish_message(RESULTS, message)

    def _count(self) -> None:
        if self._blocks:
            self._interval.add(join_blocks(self._blocks))
            self._blocks.clear()
