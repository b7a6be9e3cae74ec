"""What the drill node publishes: one publisher per topic, fed block by block."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    Faults,
    JournalEntry,
    NodalPlane,
    ReactingForce,
    Status,
    Trajectory,
    Waveform,
)
from sensor_msgs.msg import JointState

from rpud_sim.bag.encoder import Encoder
from rpud_sim.ros.drill.parameters import Settings
from rpud_sim.ros.types import members_of
from rpud_sim.simulation import fields, journal
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.ledger import FaultRecord
from rpud_sim.simulation.ledger import Faults as FaultLedger
from rpud_sim.simulation.telemetry import Telemetry


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


# Reliable offers serve listeners of both kinds; the depth is what a slow one may fall behind, and
# what a node that stood still can make up for at once. Streams are large: more of them that a
# frozen or killed listener does not acknowledge would hold up the drill.
TELEMETRY_QOS = _reliable(1000)
CONTACT_FORCE_QOS = _reliable(2000)
STREAM_QOS = _reliable(40)
LATCHED_QOS = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
# Whoever comes late gets the whole of it, unless there was more.
JOURNAL_QOS = _reliable(1000, DurabilityPolicy.TRANSIENT_LOCAL)
DIAGNOSTICS_QOS = _reliable(10)
COMMAND_QOS = _reliable(1000)
# A node that joins a drill at a standstill has the time at once.
CLOCK_QOS = LATCHED_QOS

TOPICS: dict[str, tuple[type, QoSProfile]] = {
    "nodal_plane": (NodalPlane, TELEMETRY_QOS),
    "drill_tool": (DrillTool, TELEMETRY_QOS),
    "reacting_force": (ReactingForce, TELEMETRY_QOS),
    "wrench": (WrenchStamped, TELEMETRY_QOS),
    "joint_states": (JointState, TELEMETRY_QOS),
    "contact_force": (ContactForce, CONTACT_FORCE_QOS),
    "waveform": (Waveform, STREAM_QOS),
    "trajectory": (Trajectory, STREAM_QOS),
    "status": (Status, LATCHED_QOS),
    "faults": (Faults, LATCHED_QOS),
    "journal": (JournalEntry, JOURNAL_QOS),
    "/diagnostics": (DiagnosticArray, DIAGNOSTICS_QOS),
}
# All but the reports, which are messages already.
_ENCODED = {
    **{name: kind for name, (kind, _) in TOPICS.items() if name not in ("status", "/diagnostics")},
    "/clock": Clock,
}
# Of the others the last message is what counts.
_COMPLETE = [name for name, (_, qos) in TOPICS.items() if qos.depth >= STREAM_QOS.depth]

# A simulation that nothing paces waits for its listeners when a depth is used up, but not longer
# than this for one that does not answer [s].
_LONGEST_WAIT = 1.0


class DrillPublishers:
    """All publishers of the drill node, and the streams that run through them.

    Attributes:
        sent: counts of messages, see below.
        patient: whether to wait for reliable listeners rather than to overwrite what they lack.

    Args:
        node: that owns them.
        settings: rates and block length.
        sent: where to count the messages of each topic; then all are sent, also those without a
            listener. None to count none.
    """

    def __init__(self, node: Node, settings: Settings, sent: Counter[str] | None = None) -> None:
        self._node = node
        self.sent = sent
        self._dropped = 0
        self._faults: object = None
        self._unacknowledged = Counter[str]()
        self.patient = False
        self._topics = {
            name: node.create_publisher(kind, name, qos) for name, (kind, qos) in TOPICS.items()
        }
        self._encoders = {name: Encoder(members_of(kind)) for name, kind in _ENCODED.items()}
        self._telemetry = Telemetry(
            settings.telemetry_rate,
            settings.sample_rate,
            settings.block_duration,
            wanted=lambda name: (
                self.sent is not None or self._topics[name].get_subscription_count() > 0
            ),
        )
        if settings.publish_clock:
            self._topics["/clock"] = node.create_publisher(Clock, "/clock", CLOCK_QOS)

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._telemetry.origin

    @property
    def dropped(self) -> int:
        """Messages that the middleware did not take."""
        return self._dropped

    @property
    def unheard(self) -> list[str]:
        """Topics of the node's namespace that nobody listens to."""
        return [
            name
            for name, publisher in self._topics.items()
            if not (name.startswith("/") or publisher.get_subscription_count())
        ]

    def begin(self, origin: int) -> None:
        """Begin with simulation time zero, whose stamp this is [ns]."""
        self._telemetry.begin(origin)
        self._faults = None

    def move(self, origin: int) -> None:
        """Give simulation time zero another stamp [ns]."""
        self._telemetry.move(origin)
        self._faults = None

    def reseed(self, seed: int) -> None:
        """Forget the state of faulty signals, and draw with this seed from now on."""
        self._telemetry.reseed(seed)

    def publish_block(self, block: Block, faults: Sequence[FaultRecord]) -> None:
        """Publish what of a block is wanted at once: its impacts and the sample at its end.

        Args:
            block: at most one telemetry period long.
            faults: that lasted in it, or in a part of it.
        """
        self.publish_clock(block.end)
        prompt = self._telemetry.take_prompt(block, faults)
        self._send((name, values) for _, name, values in prompt)

    def publish_clock(self, time: int) -> None:
        """Publish a simulation time [ns] on ``/clock``, if the node is its source."""
        if "/clock" in self._topics:
            self._send([("/clock", {"clock": fields.time_fields(self.origin + time)})])

    def publish_streams(self, block: Block) -> None:
        """Publish the waveform and the trajectory where one of their blocks ends with this one."""
        self._send((name, values) for _, name, values in self._telemetry.take_streams(block))

    def flush(self) -> None:
        """Publish the waveform and the trajectory up to the end of the last block."""
        self._send((name, values) for _, name, values in self._telemetry.flush())

    def publish_faults(self, ledger: FaultLedger, time: int) -> None:
        """Publish the ground truth of faults at a simulation time [ns], if it has changed."""
        if ledger.active is not self._faults:
            self._faults = ledger.active
            self._send([("faults", fields.faults_fields(ledger, time, self.origin))])

    def publish_journal(self, entries: Iterable[journal.JournalEntry]) -> None:
        """Publish what has changed the simulation."""
        self._send(("journal", fields.journal_fields(entry, self.origin)) for entry in entries)

    def publish_status(self, status: Status) -> None:
        """Publish a status."""
        self._publish("status", status)

    def publish_diagnostics(self, diagnostics: DiagnosticArray) -> None:
        """Publish diagnostics."""
        self._publish("/diagnostics", diagnostics)

    def wait_for_listeners(self, seconds: float = _LONGEST_WAIT) -> None:
        """Wait until reliable listeners have everything, but not longer than this in all."""
        end = time.monotonic() + seconds
        for name, publisher in self._topics.items():
            if not name.startswith("/"):
                # A listener that was killed never acknowledges.
                publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))

    def destroy(self) -> None:
        """Take the publishers from the graph."""
        for publisher in self._topics.values():
            self._node.destroy_publisher(publisher)
        self._topics.clear()

    def _send(self, entries: Iterable[tuple[str, fields.Fields]]) -> None:
        # All are made before the first one goes: what follows at once finds a listener awake, and
        # to wake one costs more than the rest of sending.
        messages = [(name, self._encoders[name].encode(values)) for name, values in entries]
        for name, message in messages:
            self._publish(name, message)

    def _publish(self, name: str, message: Any) -> None:
        try:
            self._topics[name].publish(message)
            if self.sent is not None:
                self.sent[name] += 1
            self._unacknowledged[name] += 1
            if self.patient and name in _COMPLETE:
                self._await(name)
        except RuntimeError:  # RCLError: the middleware did not take it
            self._dropped += 1

    def _await(self, name: str) -> None:
        """Let reliable listeners catch up before the oldest messages would be overwritten."""
        if self._unacknowledged[name] >= TOPICS[name][1].depth:
            # For all at once: to hear from the listeners of one takes as long as of all.
            self.wait_for_listeners()
            self._unacknowledged.clear()
