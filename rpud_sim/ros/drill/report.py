"""Reports on the drill: its state at a block boundary, published as status and diagnostics."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rpud_msgs.msg import CommandResults
from std_msgs.msg import Header

from rpud_sim.drilling.mount import FEED_MODES, RATE
from rpud_sim.drilling.process import ProcessState
from rpud_sim.drilling.rock import NO_DEEPER
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.pacer import Pacer, Punctuality
from rpud_sim.ros.drill.publishers import RESULTS, DrillPublishers, nanoseconds_to_time
from rpud_sim.simulation.block import Block, join_blocks
from rpud_sim.simulation.faults import FaultRecord
from rpud_sim.simulation.fields import Bookkeeping
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.statistics import Figures, Statistics
from rpud_sim.simulation.topics import MOUNT_FRAME, Fields

# Power that the steps of the arm may lose or win, as a share of the work of actuator and feed.
COUPLING_SHARE = 0.05
LEAST_POWER = 0.1  # of both, so that a drill at rest is none [W]
# Amplitude below which a driven vibration is stalled, as a share of that without load.
STALLED_SHARE = 0.05
LAG_ERROR = 1.0  # simulation time this far behind its schedule is an error [s]

REPORT_PERIOD = 1.0  # of status and diagnostics [s]
CHANGE_PERIOD = 0.05  # of reports that commands cause while time goes on, at least [s]
_BATCH_SIZE = 20  # blocks that are counted at once: one by one would take most of the time
# Topics that command the same: two publishers on one line are a mistake.
_COMMAND_TOPICS = (
    ("command/weight_on_bit",),
    ("command/drive",),
    ("command/feed", "joint_commands"),
)


@dataclasses.dataclass(frozen=True)
class Report:
    """State of the node at a block boundary."""

    time: int  # simulation time [ns]
    status: Fields  # the fields of its ``rpud_msgs/Status``
    coupling_power: float  # that the steps of the arm lose [W]; NaN without a feed
    # of the driven vibration without load, on resonance [m]; 0 where no load acts on it
    unloaded_amplitude: float
    process: ProcessState  # state of rotation, feed and borehole
    at_tool_length: bool  # whether the hole is as deep as the drill tool is long
    faults: tuple[FaultRecord, ...]  # that last
    requests_refused: int  # of services, since the start
    last_refusal: str  # why the latest command or request was refused
    namesakes: int  # other nodes of the same name
    scheduling: str  # how the system schedules the pacing thread
    timing: Punctuality  # punctuality of the blocks
    # of commands, from their arrival until they acted, in the last second
    command_delays: DelayHistogram
    # of impacts, from their stamps until they were published, in the last second
    impact_delays: DelayHistogram
    figures: Figures  # of the interval since the report before
    published: Mapping[str, int]  # messages by topic, the status of this report among them
    subscribers: Mapping[str, int]  # by topic
    publishers: Mapping[str, int]  # whose commands reach the node, by topic
    acknowledged: bool  # whether all reliable subscribers have every message


def report_to_diagnostics(
    report: Report, node_name: str, stamp: Time, telemetry_rate: int
) -> DiagnosticArray:
    """Convert to diagnostics of timing and of commands; the stamp is that of the node's clock."""
    timing, status = report.timing, report.status
    parts: dict[str, tuple[tuple[bytes, str], dict[str, object]]] = {
        "timing": (
            _timing_health(timing, telemetry_rate),
            {
                "real_time_factor": f"{timing.real_time_factor:.4f}",
                "blocks": timing.blocks,
                "deadlines_missed": timing.deadlines_missed,
                "lateness [s]": f"{timing.lateness:.6f}",
                "lateness_max [s]": f"{timing.lateness_max:.6f}",
                "lateness_p50 [s]": f"{timing.lateness_p50:.6f}",
                "lateness_p99 [s]": f"{timing.lateness_p99:.6f}",
                "lateness_p99.9 [s]": f"{timing.lateness_p999:.6f}",
                "lag [s]": f"{timing.lag:.6f}",
                **_delay_values("impact", report.impact_delays),
                "scheduling": report.scheduling,
                **_fields(status, "messages_dropped"),
            },
        ),
        "commands": (
            _command_health(status),
            {
                **_fields(status, "commands_accepted", "commands_rejected", "commands_discarded"),
                **_delay_values("command", report.command_delays),
                "requests_refused": report.requests_refused,
                "last_refusal": report.last_refusal,
                **_fields(status, "weight_on_bit [N]", "drive_enabled", "drive_voltage [V]"),
                **_fields(status, "drive_frequency [Hz]"),
                **_feed_values(report),
                **_fields(status, "commanders"),
            },
        ),
        "drill": (
            _drill_health(report),
            {
                **_fields(status, "state", "regime", "impacts", "vibration_amplitude [m]"),
                **_fields(status, "resonance_frequency [Hz]", "actuator_temperature [K]"),
                **_fields(status, "electrical_power [W]", "depth [m]", "penetration_rate [m/s]"),
                **_arm_values(report),
                **_fields(status, "active_faults"),
                "namesakes": report.namesakes,
            },
        ),
        "messages": (
            _message_health(status),
            {
                "published": _numbers(report.published),
                "subscribers": _numbers(report.subscribers),
                "publishers": _numbers(report.publishers),
                "acknowledged": report.acknowledged,
            },
        ),
    }
    return DiagnosticArray(
        header=Header(stamp=stamp),
        status=[
            DiagnosticStatus(
                level=level,
                name=f"{node_name}: {name}",
                message=text,
                hardware_id="rpud_sim",
                values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
            )
            for name, ((level, text), values) in parts.items()
        ],
    )


def _fields(status: Fields, *keys: str) -> dict[str, object]:
    """Return fields of a status, each by its name and its unit in brackets."""
    values = {key: status[key.partition(" ")[0]] for key in keys}
    return {key: f"{each:g}" if isinstance(each, float) else each for key, each in values.items()}


def _delay_values(name: str, delays: DelayHistogram) -> dict[str, object]:
    return {
        f"{name}_delay_p50 [s]": f"{delays.quantile(0.5):.6f}",
        f"{name}_delay_p99 [s]": f"{delays.quantile(0.99):.6f}",
        f"{name}_delay_max [s]": f"{delays.greatest:.6f}",
    }


def _feed_values(report: Report) -> dict[str, object]:
    """Return the feed in force, in the unit of its mode; nothing without a feed."""
    if report.process.mount is None:
        return {}
    mode = FEED_MODES[report.status["feed_mode"]]
    unit = "m/s" if mode == RATE else "m"
    return {"feed_mode": mode, **_fields(report.status, f"feed_value [{unit}]")}


def _arm_values(report: Report) -> dict[str, object]:
    """Return how far the bit has walked, and what the steps of the arm lose, if modelled."""
    values: dict[str, object] = {}
    if (borehole := report.process.borehole) is not None:
        values["side_offset [m]"] = f"{borehole.side_offset:g}"
    if report.process.mount is not None:
        values["coupling_power [W]"] = f"{report.coupling_power:.3g}"
    return values


def _timing_health(timing: Punctuality, telemetry_rate: int) -> tuple[bytes, str]:
    if timing.lag > LAG_ERROR:
        return DiagnosticStatus.ERROR, f"simulation time lags {timing.lag:.3f} s behind"
    if timing.lateness_max * telemetry_rate > 1.0:
        return DiagnosticStatus.WARN, f"a block was {timing.lateness_max:.3f} s late"
    return DiagnosticStatus.OK, "on time"


def _command_health(status: Fields) -> tuple[bytes, str]:
    if status["commands_lost"]:
        return DiagnosticStatus.ERROR, "commands are lost: the drill is made safe"
    if status["commands_discarded"]:
        return DiagnosticStatus.WARN, f"{status['commands_discarded']} discarded"
    if status["commanders"] > 1:
        return DiagnosticStatus.WARN, f"{status['commanders']} publishers command at once"
    return DiagnosticStatus.OK, f"{status['commands_rejected']} refused"


def _drill_health(report: Report) -> tuple[bytes, str]:
    if report.namesakes:
        return DiagnosticStatus.WARN, f"{report.namesakes + 1} nodes have this name"
    amplitude, unloaded = report.status["vibration_amplitude"], report.unloaded_amplitude
    if amplitude < STALLED_SHARE * unloaded:
        return DiagnosticStatus.WARN, (
            f"stalled: the vibration has {amplitude * 1e6:.2g} um, less than {STALLED_SHARE:.0%} "
            f"of {unloaded * 1e6:.3g} um without load"
        )
    powers = (report.status["actuator_power"], report.status["feed_power"], LEAST_POWER)
    flow = max(map(abs, powers))
    if abs(report.coupling_power) > COUPLING_SHARE * flow:
        return DiagnosticStatus.WARN, (
            f"steps of the arm lose {report.coupling_power:.3g} W, more than {COUPLING_SHARE:.0%} "
            f"of {flow:.3g} W: the arm is too soft or too lightly damped for them"
        )
    if faults := report.status["active_faults"]:
        return DiagnosticStatus.WARN, f"{faults} faults injected"
    if report.at_tool_length:
        return DiagnosticStatus.WARN, NO_DEEPER
    return DiagnosticStatus.OK, report.status["state"]


def _message_health(status: Fields) -> tuple[bytes, str]:
    if status["messages_dropped"]:
        return DiagnosticStatus.WARN, f"{status['messages_dropped']} dropped"
    return DiagnosticStatus.OK, "none dropped"


def _numbers(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items())


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
        self.impact_delays = DelayHistogram()  # of impacts until they were published
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
        self.impact_delays = DelayHistogram()
        self._due = 0

    def add(self, block: Block) -> None:
        self._blocks.append(block)
        if len(self._blocks) >= _BATCH_SIZE:
            self._count()

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
            impact_delays, self.impact_delays = self.impact_delays, DelayHistogram()
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
