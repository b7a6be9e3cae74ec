"""The drill: the node, and the executable `drill_node` of `ros2 run`."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import Drive as DriveMessage
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage

from rpud_sim.ros.inbox import Inbox
from rpud_sim.ros.pacing import Pacer
from rpud_sim.ros.parameters import Settings, declare_settings
from rpud_sim.ros.publishers import COMMAND_QOS, DrillPublishers
from rpud_sim.ros.report import Report, report_to_diagnostics, report_to_status
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.simulation import ParameterError
from rpud_sim.simulation.commands import Drive, WeightOnBit, vibration_amplitude
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

REPORT_PERIOD = 1.0  # of status and diagnostics [s]
_ACKNOWLEDGEMENT = 1.0  # that the last messages may take to reach their listeners [s]


class DrillNode(Node):
    """A drill in soft real time.

    Publishers (relative names; see the README for types and QoS): ``nodal_plane``, ``drill_tool``,
    ``reacting_force`` and ``wrench`` at ``telemetry_rate``; ``contact_force`` for every impact on
    the drill tool; ``waveform`` and ``trajectory`` in blocks; ``status`` and ``/diagnostics`` every
    second and on change; ``/clock`` with ``publish_clock``.

    Subscriptions: ``command/weight_on_bit`` (rpud_msgs/WeightOnBit), ``command/drive``
    (rpud_msgs/Drive). A command takes effect at the next block boundary; one that cannot be used is
    refused, counted and logged, and changes nothing.

    Parameters: those of ``rpud_sim.simulation.Parameters``, and ``drive_enabled``,
    ``nominal_voltage``, ``telemetry_rate``, ``sample_rate``, ``block_duration``, ``publish_clock``.

    Args:
        options: keyword arguments of ``rclpy.node.Node``.

    Raises:
        ParameterError: if a parameter has a value that cannot be used.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("drill_node", **options)
        self._settings = declare_settings(self)
        compile_kernels(self._settings.parameters)
        self._outputs = DrillPublishers(self, self._settings)
        self._inbox = Inbox(self.get_logger())
        self.create_subscription(
            WeightOnBitMessage, "command/weight_on_bit", self._on_weight_on_bit, COMMAND_QOS
        )
        self.create_subscription(DriveMessage, "command/drive", self._on_drive, COMMAND_QOS)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pacing")
        self._failure: BaseException | None = None
        self._reports: deque[Report] = deque(maxlen=1)
        self._totals = Statistics()

    @property
    def settings(self) -> Settings:
        """What it runs with."""
        return self._settings

    @property
    def report(self) -> Report | None:
        """The latest report, None before the first."""
        return self._reports[-1] if self._reports else None

    @property
    def failure(self) -> BaseException | None:
        """What ended the pacing thread before it was asked to stop, if anything did."""
        return self._failure

    @property
    def totals(self) -> Statistics:
        """Statistics since the start; to be read when it has stopped."""
        return self._totals

    def start(self) -> None:
        """Begin to drill: simulation time zero is now."""
        self._thread.start()

    def stop(self) -> None:
        """End the drilling, publish the last status, and let listeners have the last messages."""
        if self._thread.is_alive():
            self._stop.set()
            self._thread.join()
        self._outputs.wait_for_all_acked(_ACKNOWLEDGEMENT)

    def _on_weight_on_bit(self, message: WeightOnBitMessage) -> None:
        try:
            self._inbox.accept(WeightOnBit(message.force))
        except ParameterError as error:
            self._inbox.refuse(str(error))

    def _on_drive(self, message: DriveMessage) -> None:
        settings = self._settings
        try:
            drive = Drive(message.enabled, message.voltage, message.frequency)
            vibration_amplitude(drive, settings.parameters, settings.nominal_voltage)
            self._inbox.accept(drive)
        except ParameterError as error:
            self._inbox.refuse(str(error))

    def _origin(self) -> int:
        """Stamp of simulation time zero [ns]; with ``use_sim_time`` once ``/clock`` is heard."""
        if self._settings.publish_clock:
            return 0
        now = self.get_clock().now().nanoseconds
        if now == 0:
            self.get_logger().info("waiting for /clock, as use_sim_time is set")
        while now == 0 and not self._stop.wait(0.01):
            now = self.get_clock().now().nanoseconds
        return now

    def _run(self) -> None:
        try:
            self._drill()
        except (
            Exception
        ) as error:  # whatever it is, the process must end with it and not go on silent
            self._failure = error

    def _drill(self) -> None:
        settings = self._settings
        simulation = Simulation(
            settings.parameters,
            drive_enabled=settings.drive_enabled,
            nominal_voltage=settings.nominal_voltage,
        )
        outputs = self._outputs
        outputs.begin(self._origin())
        interval = Statistics()
        pacer = Pacer(settings.telemetry_rate)
        self.get_logger().info(
            f"drilling: regime {settings.parameters.regime}, weight on bit "
            f"{settings.parameters.weight_on_bit:g} N, drive "
            f"{'on' if settings.drive_enabled else 'off'}"
        )

        def report(state: str) -> None:
            nonlocal interval
            made = Report(
                state=state,
                time=simulation.time,
                regime=settings.parameters.regime,
                applied=simulation.applied,
                impacts=simulation.impact_count,
                commands_accepted=self._inbox.accepted,
                commands_rejected=self._inbox.rejected,
                messages_dropped=outputs.dropped,
                timing=pacer.take(),
                figures=interval.figures(),
            )
            interval = Statistics()
            self._reports.append(made)
            outputs.publish_status(report_to_status(made, outputs.origin))
            outputs.publish_diagnostics(
                report_to_diagnostics(
                    made,
                    self.get_fully_qualified_name(),
                    self.get_clock().now().to_msg(),
                    settings.telemetry_rate,
                )
            )

        report("running")
        while not self._stop.is_set():
            pacer.wait()
            block = simulation.advance_to(pacer.block_end())
            outputs.publish_block(block)
            interval.add(block)
            self._totals.add(block)
            commands = self._inbox.take()
            for command in commands:
                simulation.apply(command)
            pacer.finish()
            full_period = interval.duration >= REPORT_PERIOD
            if commands or full_period or self._inbox.refused_since_report:
                self._inbox.refused_since_report = False
                report("running")
        outputs.flush()
        report("stopped")


def main() -> None:
    """Run the executable until SIGINT or SIGTERM: exit 0; 1 after a failure, 2 for bad parameters."""
    sys.exit(_main())


def _main() -> int:
    with StopRequest() as stop:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = DrillNode()
        except ParameterError as error:
            print(f"drill_node: {error}", file=sys.stderr)
            rclpy.try_shutdown()
            return 2
        try:
            return spin(node, stop)
        finally:
            rclpy.try_shutdown()


def spin(node: DrillNode, stop: StopRequest, duration: float | None = None) -> int:
    """Drill until the stop is requested or the duration [s] is over; return the exit code."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.start()
    end = time.monotonic() + duration if duration is not None else float("inf")
    try:
        while not stop.requested and node.failure is None and time.monotonic() < end:
            executor.spin_once(timeout_sec=min(0.1, max(0.0, end - time.monotonic())))
    finally:
        node.stop()
    if node.failure is not None:
        print(f"drill_node: {node.failure}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    main()
