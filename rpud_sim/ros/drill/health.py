"""Health of the drill: its status and diagnostics, every second and on change."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

from rclpy.node import Node

from rpud_sim.drilling.process import ProcessState
from rpud_sim.drilling.rock import NO_DEEPER
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, Fields
from rpud_sim.ros.drill.commands import Inbox
from rpud_sim.ros.drill.managed_node import DuplicateNodes
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.timeline import Pacer
from rpud_sim.ros.graph import ClockSources
from rpud_sim.ros.threads import DelayHistogram
from rpud_sim.simulation.block import Block, join_blocks
from rpud_sim.simulation.faults import FaultRecord
from rpud_sim.simulation.fields import CommandCounts, header_fields, prefixed, time_fields
from rpud_sim.simulation.metrics import Metrics, Values
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import JOINT_COMMANDS

# Power that the steps of the arm may lose or win, as a share of the work of actuator and feed.
COUPLING_SHARE = 0.05
_SWINGS = (
    "the mount swings: its velocity changes sign with each sample; exchange motion and "
    "force more often, or take mount.stiffness and mount.damping implicitly"
)
LEAST_POWER = 0.1  # of both, so that a drill at rest is none [W]
# Amplitude below which a driven vibration is stalled, as a share of that without load.
STALLED_SHARE = 0.05
LAG_ERROR = 1.0  # simulation time this far behind its schedule is an error [s]

REPORT_PERIOD = 1.0  # of status and diagnostics [s]
CHANGE_PERIOD = 0.05  # of reports that commands cause while time continues, at least [s]
_BATCH_SIZE = 20  # blocks that are counted together: one by one would take most of the time
# Topics that command the same: two publishers on one line are a mistake.
_COMMAND_TOPICS = (
    ("command/weight_on_bit",),
    ("command/drive",),
    ("command/feed", JOINT_COMMANDS),
    ("command/mount",),
)
_OK, _WARN, _ERROR = range(3)  # levels of diagnostics


class Report(NamedTuple):
    """State of the node at a block boundary."""

    time: int  # simulation time [ns]
    status: Fields  # of its ``rpud_msgs/Status``
    timing: Fields  # of its ``rpud_msgs/Timing``
    figures: Values  # of the second before the latest full report
    process: ProcessState  # state of rotation, feed and borehole
    faults: tuple[FaultRecord, ...]  # that last
    requests_refused: int  # of services, since the start
    last_refusal: str  # why the latest command or request was rejected


_TIMING = ("real_time_factor", "lateness_max", "lag", "deadlines_missed")  # that a pacer measures

KEYS = {
    "timing": (
        "real_time_factor, blocks, deadlines_missed, lateness [s], lateness_max [s], "
        "lateness_p50 [s], lateness_p99 [s], lateness_p99.9 [s], lag [s], impact_delay_p50 [s], "
        "impact_delay_p99 [s], impact_delay_max [s], scheduling, messages_dropped"
    ),
    "commands": (
        "commands_accepted, commands_rejected, commands_discarded, command_delay_p50 [s], "
        "command_delay_p99 [s], command_delay_max [s], requests_refused, last_refusal, "
        "weight_on_bit [N], drive_enabled, drive_voltage [V], drive_frequency [Hz], "
        "feed_rate [m/s], feed_position [m], mount_position [m], mount_velocity [m/s], commanders"
    ),
    "drill": (
        "state, regime, impacts, vibration_amplitude [m], resonance_frequency [Hz], "
        "actuator_temperature [degC], electrical_power [W], depth [m], penetration_rate [m/s], "
        "side_offset [m], coupling_power [W], active_faults, duplicates"
    ),
    "messages": "messages_dropped, journal_dropped",
}
"""Keys of each entry of /diagnostics; a value that does not exist is left out."""


def diagnose(run: Run, values: Fields, period: float) -> list[Fields]:
    """Return the entries of diagnostics.

    ``values`` are the fields of a report, and what was measured; ``period`` is of blocks [s].
    """
    borehole = run.simulation.process.borehole
    health = _health(run, values, period)
    if borehole is not None:
        values = {**values, "side_offset": borehole.side_offset}
    return [
        {
            "level": health[part][0],
            "name": part,
            "message": health[part][1],
            "hardware_id": "rpud_sim",
            "values": [
                {"key": key, "value": _text(value)}
                for key in keys.split(", ")
                if (value := values.get(key.partition(" ")[0])) is not None and value == value
            ],
        }
        for part, keys in KEYS.items()
    ]


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _health(run: Run, values: Fields, period: float) -> dict[str, tuple[int, str]]:
    """Return level and message of each part of the diagnostics: the first ones that apply."""
    lag, late, duplicates = values["lag"], values["lateness_max"], values["duplicates"]
    discarded, commanders = values["commands_discarded"], values["commanders"]
    amplitude, unloaded = values["vibration_amplitude"], run.simulation.unloaded_amplitude
    dropped, faults = values["messages_dropped"], values["active_faults"]
    forgotten = values["journal_dropped"]
    lost = values["coupling_power"]
    mount = run.simulation.process.mount
    flow = max(abs(values["actuator_power"]), abs(values["feed_power"]), LEAST_POWER)
    rules = (
        ("timing", _ERROR, lag > LAG_ERROR, f"simulation time lags {lag:.3f} s behind"),
        ("timing", _WARN, late > period, f"a block was {late:.3f} s late"),
        ("timing", _OK, True, "on time"),
        (
            "commands",
            _ERROR,
            values["commands_lost"],
            "commands are lost: drive and weight on bit are ramped to zero",
        ),
        ("commands", _WARN, discarded, f"{discarded} discarded"),
        ("commands", _WARN, commanders > 1, f"{commanders} publishers send commands"),
        ("commands", _OK, True, f"{values['commands_rejected']} rejected"),
        ("drill", _WARN, duplicates, f"{duplicates + 1} nodes have this name"),
        (
            *("drill", _WARN, amplitude < STALLED_SHARE * unloaded),
            f"stalled: the vibration has {amplitude * 1e6:.2g} um, less than {STALLED_SHARE:.0%} "
            f"of {unloaded * 1e6:.3g} um without load",
        ),
        (
            *("drill", _WARN, abs(lost) > COUPLING_SHARE * flow),
            f"steps of the arm lose {lost:.3g} W, more than {COUPLING_SHARE:.0%} of {flow:.3g} W: "
            "the arm is too soft or too lightly damped for them",
        ),
        ("drill", _WARN, mount is not None and mount.swings, _SWINGS),
        ("drill", _WARN, faults, f"{faults} faults injected"),
        ("drill", _WARN, run.simulation.at_tool_length, NO_DEEPER),
        ("drill", _OK, True, values["state"]),
        ("messages", _WARN, dropped, f"{dropped} dropped"),
        ("messages", _WARN, forgotten, f"the first {forgotten} entries of the journal are dropped"),
        ("messages", _OK, True, "none dropped"),
    )
    return {part: (level, text) for part, level, applies, text in reversed(rules) if applies}


class StatusReporter:
    """Statistics and reports, every second and on demand; ``telemetry_rate`` is in Hz."""

    def __init__(
        self,
        node: Node,
        telemetry_rate: int,
        publishers: DrillPublishers,
        inbox: Inbox,
        duplicates: DuplicateNodes,
    ) -> None:
        self.scheduling = "time-sharing"  # how the system schedules the pacing thread
        self.last: Report | None = None  # the latest report, None before the first
        self._node = node
        self._period = 1.0 / telemetry_rate
        self._publishers = publishers
        self._inbox = inbox
        self._duplicates = duplicates
        self._sources = ClockSources(node)
        self._command_topics = [
            [node.resolve_topic_name(topic) for topic in topics] for topics in _COMMAND_TOPICS
        ]
        self._blocks: list[Block] = []
        self._measured: Fields = {}  # by the latest full report
        self._figures: Values = {}  # of it
        self._diagnostics: Fields | None = None  # that are not published yet
        self._rests_until = 0
        self._forgotten = 0  # entries of the journal that are not kept any more
        self.begin()

    @property
    def totals(self) -> Metrics:
        """Metrics since the start; to be read when the drilling has ended."""
        self._count()
        totals = Metrics()
        totals.merge(self._totals)
        totals.merge(self._interval)
        return totals

    def begin(self) -> None:
        """Count from zero."""
        self._blocks.clear()
        self._totals = Metrics()
        self._interval = Metrics()
        self._inbox.begin()
        self.impact_delays = DelayHistogram()  # of impacts until they were published
        self.end_period()

    def add(self, block: Block) -> None:
        self._blocks.append(block)
        if len(self._blocks) >= _BATCH_SIZE:
            self._count()

    def due(self) -> bool:
        """Whether it is time for a full report."""
        return time.monotonic_ns() >= self._due

    def end_period(self) -> None:
        """Make the next report a full one."""
        self._due = 0

    def refused_more(self) -> bool:
        """Whether commands were rejected or discarded since the last report."""
        return self.last is not None and (
            self._inbox.rejected != self.last.status["commands_rejected"]
            or self._inbox.discarded != self.last.status["commands_discarded"]
        )

    @property
    def rested(self) -> bool:
        """Whether the last report is long enough ago for one of changes."""
        return time.monotonic_ns() >= self._rests_until

    def report(self, state: str, run: Run, pacer: Pacer) -> None:
        """Publish the status with a STATE; diagnostics wait for ``publish_diagnostics``."""
        if self.last is None or self.due():
            self.publish_diagnostics()  # one in each period, even where time is short
            self._measure(pacer)
        status = run.status(
            state,
            CommandCounts(
                commands_accepted=self._inbox.accepted,
                commands_rejected=self._inbox.rejected,
                commands_discarded=self._inbox.discarded,
                commanders=self._count_commanders(),
            ),
        )
        power = run.power()
        timing = {
            "header": header_fields("timing", run.origin + run.time),
            **{name: self._measured[name] for name in _TIMING},
            "messages_dropped": self._publishers.dropped,
        }
        prefix = run.settings.frame_prefix
        measured_timing = Batch.of(run.time, "timing", prefixed(timing, prefix))
        # The status last: who gets it finds the others.
        self._publishers.publish([power, measured_timing, status])
        self._inbox.publish_results(self._publishers, run.origin + run.time, prefix)
        simulation = run.simulation
        self.last = Report(
            time=run.time,
            status=status.fields,
            timing=timing,
            figures=self._figures,
            process=simulation.process,
            faults=simulation.faults.active,
            requests_refused=self._inbox.requests_refused,
            last_refusal=self._inbox.last_refusal,
        )
        if self._publishers.diagnosed:
            self._diagnose(run, {**power.fields, **timing, **status.fields})
        self._rests_until = time.monotonic_ns() + round(CHANGE_PERIOD * SECOND)

    def _count_commanders(self) -> int:
        # rclpy's count_publishers() would resolve each name again, at every report.
        handle = self._node.handle
        with handle:
            return max(sum(map(handle.get_count_publishers, each)) for each in self._command_topics)

    def _diagnose(self, run: Run, values: Fields) -> None:
        """Make the diagnostics of the latest report, which take longer than the report itself."""
        assert self.last is not None  # it is the latest report
        values |= {
            **self._measured,
            "requests_refused": self.last.requests_refused,
            "last_refusal": self.last.last_refusal,
            "scheduling": self.scheduling,
        }
        entries = diagnose(run, values, self._period)
        for entry in entries:
            entry["name"] = f"{self._node.get_fully_qualified_name()}: {entry['name']}"
        stamp = time_fields(self._node.get_clock().now().nanoseconds)
        self._diagnostics = {"header": {"stamp": stamp, "frame_id": ""}, "status": entries}

    def publish_diagnostics(self) -> None:
        """Publish the diagnostics of the latest report, unless that was done."""
        if self._diagnostics is not None:
            self._publishers.publish([Batch.of(0, "/diagnostics", self._diagnostics)])
            self._diagnostics = None

    def _count_forgotten(self) -> int:
        """Return how many entries of the journal are not kept any more; warn at the first."""
        forgotten = self._publishers.journal.first_kept
        if forgotten and not self._forgotten:
            self._node.get_logger().warning(
                "the first entries of the journal are dropped: a recorder that starts now gets "
                "no whole journal"
            )
        self._forgotten = forgotten
        return forgotten

    def _measure(self, pacer: Pacer) -> None:
        """Take what is of the time since the full report before."""
        self._due = time.monotonic_ns() + round(REPORT_PERIOD * SECOND)
        self._sources.look()
        self._count()
        self._figures = self._interval.values()
        self._totals.merge(self._interval)
        self._interval = Metrics()
        impact_delays, self.impact_delays = self.impact_delays, DelayHistogram()
        self._measured = {
            **pacer.read(),
            "duplicates": self._duplicates.count(),
            "journal_dropped": self._count_forgotten(),
        }
        for name, delays in ("command", self._inbox.take_delays()), ("impact", impact_delays):
            self._measured[f"{name}_delay_p50"] = delays.quantile(0.5)
            self._measured[f"{name}_delay_p99"] = delays.quantile(0.99)
            self._measured[f"{name}_delay_max"] = delays.greatest

    def _count(self) -> None:
        if self._blocks:
            self._interval.add(join_blocks(self._blocks))
            self._blocks.clear()
