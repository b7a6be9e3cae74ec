"""What the drill node publishes: one publisher per topic, fed block by block."""

from __future__ import annotations

import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    NodalPlane,
    ReactingForce,
    Status,
    Trajectory,
    Waveform,
)
from sensor_msgs.msg import JointState

from rpud_sim.ros import messages
from rpud_sim.ros.parameters import Settings
from rpud_sim.simulation.sampling import NANOSECONDS, Times
from rpud_sim.simulation.simulation import Block, join_blocks


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)


# Reliable offers serve listeners of both kinds; the depth is what a slow one may fall behind, and
# what a node that stood still can make up for at once. Streams are large: more of them that a
# frozen or killed listener does not acknowledge would hold up the drill.
TELEMETRY_QOS = _reliable(1000)
CONTACT_FORCE_QOS = _reliable(2000)
STREAM_QOS = _reliable(40)
STATUS_QOS = _reliable(1, DurabilityPolicy.TRANSIENT_LOCAL)
DIAGNOSTICS_QOS = _reliable(10)
COMMAND_QOS = _reliable(1000)
CLOCK_QOS = _reliable(10)


class DrillPublishers:
    """All publishers of the drill node, and the streams that run through them.

    Args:
        node: that owns them.
        settings: rates and block length.
    """

    def __init__(self, node: Node, settings: Settings) -> None:
        self._sample_rate = settings.sample_rate
        self._stream_period = round(settings.block_duration * settings.telemetry_rate)
        self._origin = 0
        self._segments = 0
        self._pending: list[Block] = []
        self._dropped = 0
        self._nodal_plane = node.create_publisher(NodalPlane, "nodal_plane", TELEMETRY_QOS)
        self._drill_tool = node.create_publisher(DrillTool, "drill_tool", TELEMETRY_QOS)
        self._reacting_force = node.create_publisher(ReactingForce, "reacting_force", TELEMETRY_QOS)
        self._wrench = node.create_publisher(WrenchStamped, "wrench", TELEMETRY_QOS)
        self._joint_states = node.create_publisher(JointState, "joint_states", TELEMETRY_QOS)
        self._contact_force = node.create_publisher(
            ContactForce, "contact_force", CONTACT_FORCE_QOS
        )
        self._waveform = node.create_publisher(Waveform, "waveform", STREAM_QOS)
        self._trajectory = node.create_publisher(Trajectory, "trajectory", STREAM_QOS)
        self._status = node.create_publisher(Status, "status", STATUS_QOS)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", DIAGNOSTICS_QOS)
        self._clock = (
            node.create_publisher(Clock, "/clock", CLOCK_QOS) if settings.publish_clock else None
        )

    @property
    def origin(self) -> int:
        """Stamp of simulation time zero [ns]."""
        return self._origin

    @property
    def dropped(self) -> int:
        """Messages that the middleware did not take."""
        return self._dropped

    def begin(self, origin: int) -> None:
        """Set the stamp of simulation time zero [ns]."""
        self._origin = origin

    def publish_block(self, block: Block) -> None:
        """Publish what a block brings: the sample at its end, its impacts, its share of streams."""
        stamp = self._origin + block.end
        samples = block.sample(Times.from_nanoseconds(block.end))
        if self._clock is not None:
            self._publish(self._clock, Clock(clock=messages.nanoseconds_to_time(stamp)))
        self._publish(self._nodal_plane, messages.samples_to_nodal_plane(samples, 0, stamp))
        self._publish(self._drill_tool, messages.samples_to_drill_tool(samples, 0, stamp))
        self._publish(self._reacting_force, messages.samples_to_reacting_force(samples, 0, stamp))
        self._publish(self._wrench, messages.samples_to_wrench(samples, 0, stamp))
        if self._joint_states.get_subscription_count():
            self._publish(self._joint_states, messages.samples_to_joint_state(samples, 0, stamp))
        for impact in block.impacts:
            message = messages.impact_to_contact_force(impact, self._origin)
            self._publish(self._contact_force, message)
        self._pending.append(block)
        if len(self._pending) >= self._stream_period:
            self.flush()

    def flush(self) -> None:
        """Publish the waveform and the trajectory up to the end of the last block."""
        if not self._pending:
            return
        block = join_blocks(self._pending)
        self._pending.clear()
        self._publish_waveform(block)
        count = len(block.segments)
        if count and self._trajectory.get_subscription_count():
            for message in messages.segments_to_trajectories(block, self._segments, self._origin):
                self._publish(self._trajectory, message)
        self._segments += count

    def publish_status(self, status: Status) -> None:
        """Publish a status."""
        self._publish(self._status, status)

    def publish_diagnostics(self, diagnostics: DiagnosticArray) -> None:
        """Publish diagnostics."""
        self._publish(self._diagnostics, diagnostics)

    def wait_for_all_acked(self, seconds: float) -> None:
        """Wait until reliable listeners have everything, but not longer than this in all."""
        end = time.monotonic() + seconds
        for publisher in (
            self._contact_force,
            self._waveform,
            self._trajectory,
            self._status,
            self._nodal_plane,
            self._drill_tool,
            self._reacting_force,
            self._wrench,
            self._joint_states,
        ):
            # A listener that was killed never acknowledges.
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))

    def _publish_waveform(self, block: Block) -> None:
        rate = self._sample_rate
        numbers = block.grid(rate)
        if numbers and self._waveform.get_subscription_count():
            samples = block.sample(Times.from_grid(numbers.start, len(numbers), rate))
            stamp = self._origin + numbers.start * NANOSECONDS // rate
            message = messages.samples_to_waveform(samples, stamp, numbers.start, rate)
            self._publish(self._waveform, message)

    def _publish(self, publisher: Publisher, message: Any) -> None:
        try:
            publisher.publish(message)
        except RuntimeError:  # RCLError: the middleware did not take it
            self._dropped += 1
