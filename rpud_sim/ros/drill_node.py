"""The drill: the node, and the executable `drill_node` of `ros2 run`."""

from __future__ import annotations

import argparse
import sys
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rpud_msgs.msg import Drive as DriveMessage
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage

from rpud_sim.ros.inbox import Inbox
from rpud_sim.ros.pacing import NANOSECONDS, Pacer, Timing
from rpud_sim.ros.parameters import Settings, declare_settings
from rpud_sim.ros.publishers import COMMAND_QOS, DrillPublishers
from rpud_sim.ros.report import Report, report_to_diagnostics, report_to_status
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.simulation import ParameterError
from rpud_sim.simulation.commands import Drive, WeightOnBit, vibration_amplitude
from rpud_sim.simulation.ensemble import Figures, compile_kernels
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
        duration: simulation time after which it has finished [s]; None for never.
        options: keyword arguments of ``rclpy.node.Node``.

    Raises:
        ParameterError: if a parameter has a value that cannot be used.
    """

    def __init__(self, duration: float | None = None, **options: Any) -> None:
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
        self._finished = threading.Event()
        self._end = sys.maxsize if duration is None else round(duration * NANOSECONDS)
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
    def finished(self) -> bool:
        """Whether the drilling has ended, for whatever reason."""
        return self._finished.is_set()

    @property
    def failure(self) -> BaseException | None:
        """What ended the pacing thread before it was asked to stop, if anything did."""
        return self._failure

    @property
    def totals(self) -> Statistics:
        """Statistics since the start; to be read when it has stopped."""
        return self._totals

    @property
    def _last_report(self) -> Report:
        return self._reports[-1]

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
            self.get_logger().info(
                "waiting for /clock, as use_sim_time is set; stamps then go on in real time"
            )
        while now == 0 and not self._stop.wait(0.01):
            now = self.get_clock().now().nanoseconds
        return now

    def _run(self) -> None:
        # Whatever ends the thread must end the process too, or it would go on in silence.
        try:
            self._drill()
        except Exception as error:
            self._failure = error
        finally:
            self._finished.set()

    def _drill(self) -> None:
        settings = self._settings
        simulation = Simulation(
            settings.parameters,
            drive_enabled=settings.drive_enabled,
            nominal_voltage=settings.nominal_voltage,
        )
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        self.get_logger().info(
            f"drilling: regime {settings.parameters.regime}, weight on bit "
            f"{settings.parameters.weight_on_bit:g} N, drive "
            f"{'on' if settings.drive_enabled else 'off'}"
        )
        outputs = self._outputs
        outputs.begin(self._origin())
        pacer = Pacer(settings.telemetry_rate)
        interval = Statistics()
        self._publish_report("running", simulation, pacer.take(), interval.figures())
        while not self._stop.is_set() and simulation.time < self._end:
            pacer.wait()
            block = simulation.advance_to(pacer.block_end())
            outputs.publish_block(block)
            interval.add(block)
            commands = self._inbox.take()
            for command in commands:
                simulation.apply(command)
            pacer.finish()
            if interval.duration >= REPORT_PERIOD:
                self._publish_report("running", simulation, pacer.take(), interval.figures())
                self._totals.merge(interval)
                interval = Statistics()
            elif commands or self._inbox.rejected != self._last_report.commands_rejected:
                last = self._last_report
                self._publish_report("running", simulation, last.timing, last.figures)
        self._totals.merge(interval)
        outputs.flush()
        self._publish_report("stopped", simulation, pacer.take(), interval.figures())

    def _publish_report(
        self, state: str, simulation: Simulation, timing: Timing, figures: Figures
    ) -> None:
        report = Report(
            state=state,
            time=simulation.time,
            regime=self._settings.parameters.regime,
            applied=simulation.applied,
            impacts=simulation.impact_count,
            commands_accepted=self._inbox.accepted,
            commands_rejected=self._inbox.rejected,
            messages_dropped=self._outputs.dropped,
            timing=timing,
            figures=figures,
        )
        self._reports.append(report)
        self._outputs.publish_status(report_to_status(report, self._outputs.origin))
        self._outputs.publish_diagnostics(
            report_to_diagnostics(
                report,
                self.get_fully_qualified_name(),
                self.get_clock().now().to_msg(),
                self._settings.telemetry_rate,
            )
        )


def main() -> None:
    """Run the executable until SIGINT or SIGTERM: exit 0, 1 after a failure, 2 for bad input."""
    parser = argparse.ArgumentParser(
        prog="drill_node",
        description="A drill in soft real time.",
        epilog="example: drill_node --ros-args -r __ns:=/rpud --params-file config/free.yaml",
    )
    try:
        words = remove_ros_args(sys.argv)[1:]
    except RuntimeError as error:  # RCLError
        reason = str(error).partition(", at ")[0]
        print(f"drill_node: ROS arguments that cannot be used: {reason}", file=sys.stderr)
        sys.exit(2)
    parser.parse_args(words)
    sys.exit(_main())


def _main() -> int:
    with StopRequest() as stop:
        try:
            rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
            node = DrillNode()
        except (ParameterError, RuntimeError) as error:  # rcl's errors are RuntimeErrors
            print(f"drill_node: {error}", file=sys.stderr)
            rclpy.try_shutdown()
            return 2
        try:
            return spin(node, stop)
        finally:
            rclpy.try_shutdown()


def spin(
    node: DrillNode,
    stop: StopRequest,
    show: Callable[[Report | None], None] = lambda report: None,
) -> int:
    """Drill until the stop is requested or the node has finished; return the exit code.

    Args:
        node: that drills.
        stop: the request.
        show: called several times a second with the latest report.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.start()
    try:
        while not (stop.requested or node.finished):
            executor.spin_once(timeout_sec=0.1)
            show(node.report)
    finally:
        node.stop()
    if node.failure is not None:
        print(f"drill_node: {node.failure}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    main()
