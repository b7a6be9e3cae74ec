"""Managed node of the drill."""

from __future__ import annotations

import contextlib
import gc
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill import standard_services
from rpud_sim.ros.drill.account import REPORT_PERIOD, Account
from rpud_sim.ros.drill.declaration import changed_values, check_changes, declare_settings
from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.fault_services import FaultServices
from rpud_sim.ros.drill.gate import Gate
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.managed_node import ManagedNode, told
from rpud_sim.ros.drill.namesakes import Namesakes
from rpud_sim.ros.drill.pacing_thread import PacingThread
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.report import Report
from rpud_sim.ros.drill.simulation_services import SimulationServices
from rpud_sim.ros.drill.standard_services import StandardServices
from rpud_sim.ros.requests import StoppedError
from rpud_sim.ros.serving import serve
from rpud_sim.ros.starting import StartError, start_ros
from rpud_sim.ros.stopping import StopRequest
from rpud_sim.simulation.configuration import CHANGEABLE, Settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.statistics import Statistics

NAME = "drill_node"
_ACKNOWLEDGEMENT = 1.0  # that the last messages may take to reach their listeners [s]
_THREADS = 3  # a step, a short request, and whatever else comes


class DrillNode(ManagedNode):
    """A drill in soft real time: a managed node that activates itself unless told otherwise.

    Publishers (types and QoS: docs/reference/topics.md): ``nodal_plane``, ``drill_tool``,
    ``reacting_force``, ``wrench`` and ``joint_states`` at ``telemetry_rate``; ``contact_force`` for
    every impact on the drill tool; ``waveform`` and ``trajectory`` in blocks; ``faults`` when one
    begins or ends; ``status`` and ``/diagnostics`` every second and on change; ``/clock`` with
    ``publish_clock``.

    Subscriptions: ``command/weight_on_bit`` (rpud_msgs/WeightOnBit), ``command/drive``
    (rpud_msgs/Drive). A command takes effect at the next block boundary; one that cannot be used is
    refused, counted and logged, and changes nothing.

    Services: ``engage`` (std_srvs/SetBool), ``inject_fault``, ``clear_fault``, ``list_faults``,
    ``simulation/get_state``, ``simulation/set_state``, ``simulation/step``, ``simulation/run_to``,
    ``simulation/reset`` (rpud_msgs), those of a managed node, and where it is installed those of
    ``simulation_interfaces``.

    Parameters: those of ``rpud_sim.simulation.configuration.PARAMETERS``; ``CHANGEABLE`` says which
    of them may be set while it runs.

    Drive and weight on bit are zero unless it is active. Simulation time begins when it is first
    activated, and ends when it is cleaned up.

    Args:
        duration: simulation time after which it has finished [s]; None for never.
        options: keyword arguments of ``rclpy.node.Node``.

    Raises:
        ParameterError: if a parameter has a value that cannot be used.
    """

    def __init__(self, duration: float | None = None, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._settings = declare_settings(self)
        self._settings.read_scenario()  # a file that is missing ends the start, not the activation
        self._end = sys.maxsize if duration is None else round(duration * SECOND)
        self._inbox = Inbox(self.get_logger())
        self._namesakes = Namesakes(self)
        self._outputs: DrillPublishers | None = None
        self._pacing: PacingThread | None = None
        self._started = False
        self._quit = False
        self._sent: Counter[str] | None = None
        self._gate = Gate(self, self._settings, self._inbox, self._now)
        self._simulation_services = SimulationServices(self, self)
        if standard_services.INSTALLED:
            StandardServices(self, self._simulation_services, self._settings.telemetry_rate)
        FaultServices(self, self)
        self.create_timer(
            REPORT_PERIOD, self._report_before_start, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)

    @property
    def settings(self) -> Settings:
        """What it runs with."""
        return self._settings

    @property
    def drilling(self) -> Drilling | None:
        """What it does since it was first activated, None before; to be read."""
        return self._pacing.drilling if self._pacing and self._started else None

    @property
    def report(self) -> Report | None:
        """The latest report, None before the first."""
        return self._pacing.drilling.account.last if self._pacing else None

    @property
    def totals(self) -> Statistics:
        """Statistics since the start; to be read when it has stopped."""
        return self._pacing.drilling.account.totals if self._pacing else Statistics()

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        return self._quit or (self._pacing is not None and self._started and self._pacing.finished)

    @property
    def failure(self) -> BaseException | None:
        """What ended the drilling before it was asked to stop, if anything did."""
        return self._pacing.failure if self._pacing else None

    @property
    def unheard(self) -> list[str]:
        """Topics of its namespace that have no subscriber."""
        return self._outputs.unheard if self._outputs else []

    @property
    def sent(self) -> Mapping[str, int]:
        """Messages of each topic of its namespace, by absolute name, since `count_sent`."""
        return {
            self.resolve_topic_name(name): count
            for name, count in (self._sent or {}).items()
            if not name.startswith("/")
        }

    def count_sent(self) -> None:
        """Count what is sent from now on; all of it is sent, whether heard or not."""
        self._sent = Counter()
        if self._outputs is not None:
            self._outputs.sent = self._sent

    def request(self, action: Callable[[Drilling], Any]) -> Any:
        """Have something done between two blocks; return what it returns, raise what it raises.

        Raises:
            StoppedError: if the node has not been activated, or the drilling has ended.
        """
        if self._pacing is None or not self._started:
            raise StoppedError("the node has not been activated")
        return self._pacing.request(action)

    def quit(self) -> None:
        """End the node."""
        self._quit = True

    def prepare(self) -> None:
        """Configure, if it shall do so by itself and has not yet: then its topics are there.

        Raises:
            RuntimeError: if it cannot.
        """
        if self._settings.autostart and self._outputs is None:
            self._succeed(self.trigger_configure)

    def start(self) -> None:
        """Configure and activate, if it shall do so by itself.

        Raises:
            RuntimeError: if it cannot.
        """
        self.prepare()
        if self._settings.autostart:
            self._succeed(self.trigger_activate)
        else:
            self.get_logger().info("waiting for the transitions configure and activate")

    def stop(self) -> None:
        """End the drilling, publish the last status, and let listeners have the last messages."""
        if self._pacing is not None and self._outputs is not None:
            self._pacing.stop()
            self._outputs.wait_for_subscribers(_ACKNOWLEDGEMENT)

    @told
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Prepare everything; nothing moves yet."""
        settings = self._settings
        compile_kernels(settings.configuration.parameters, self.get_logger().info)
        self._outputs = DrillPublishers(self, settings.publish_clock, self._sent)
        account = Account(
            self, settings.telemetry_rate, self._outputs, self._inbox, self._namesakes
        )
        self._pacing = PacingThread(
            self, settings, self._outputs, account, self._inbox, self._restore_parameters, self._end
        )
        # To look through all that lives by now, again and again, would make blocks late.
        gc.collect()
        gc.freeze()
        return TransitionCallbackReturn.SUCCESS

    @told
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let commands act; simulation time begins, if this is the first time."""
        if self._pacing is None:
            return TransitionCallbackReturn.FAILURE
        if self._started:
            self._pacing.request(lambda drilling: drilling.activate(True))
        else:
            self._pacing.start(self._settings)
            self._started = True
        self._gate.open(True)
        self.get_logger().info("the drill is active")
        return TransitionCallbackReturn.SUCCESS

    @told
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make drive and weight on bit zero; the drill goes on without them."""
        self._gate.open(False)
        if self._pacing is not None:
            self._pacing.request(lambda drilling: drilling.activate(False))
        return TransitionCallbackReturn.SUCCESS

    @told
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the drilling, and take everything back."""
        self._gate.open(False)
        self._started = False  # or the end of the drilling would be the end of the process
        self.stop()
        if self._pacing is not None:
            self._pacing.close()
        if self._outputs is not None:
            self._outputs.destroy()
        self._pacing = self._outputs = None
        gc.unfreeze()
        return TransitionCallbackReturn.SUCCESS

    @told
    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take back what a transition that failed has left; it can be configured again."""
        return self.on_cleanup(state)

    @told
    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the drilling and the node."""
        self._gate.open(False)
        self._quit = True
        return TransitionCallbackReturn.SUCCESS

    def _succeed(self, trigger: Callable[[], TransitionCallbackReturn]) -> None:
        if trigger() != TransitionCallbackReturn.SUCCESS:
            raise RuntimeError("the drill cannot be started; the log says why")

    def refuse_request(self, reason: str) -> None:
        """Count a request that is refused, and log why."""
        self._inbox.refuse_request(reason)

    def _report_before_start(self) -> None:
        """Publish the status, as the drilling does once it has started, or at least count names."""
        if self._started:
            return
        if self._pacing is None:
            self._namesakes.count()
        else:
            self._pacing.drilling.announce()

    def _now(self) -> int:
        """The stamp that a command has if it is given now [ns]."""
        if self._settings.publish_clock and self._pacing is not None:
            run = self._pacing.drilling.run
            return run.origin + run.time
        return int(self.get_clock().now().nanoseconds)

    def _check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        if self._pacing is not None and any(change.name == "use_sim_time" for change in changes):
            reason = "use_sim_time is read-only until the drill is cleaned up"
            return SetParametersResult(successful=False, reason=reason)
        return check_changes(self._settings, changes)

    def _take_parameters(self, changes: list[Parameter]) -> None:
        if not changed_values(changes):
            return
        # All of them: a reset may set others back at the same time.
        values = {name: self.get_parameter(name).value for name in CHANGEABLE}
        self._settings = self._gate.settings = self._settings.replace(values)
        if self.drilling is not None and self.drilling.settings != self._settings:
            with contextlib.suppress(StoppedError):  # there is nothing left to change
                self.request(lambda drilling: drilling.configure(self._settings))

    def _restore_parameters(self, settings: Settings) -> None:
        """Set the parameters back to the settings with which the drill goes on after a reset."""
        self.set_parameters_atomically(
            [
                Parameter(name, value=settings.value(name))
                for name in CHANGEABLE
                if self.get_parameter(name).value != settings.value(name)
            ]
        )


def drill(ros_arguments: Sequence[str]) -> None:
    """Run a drill until SIGINT, SIGTERM or the end of its node.

    Args:
        ros_arguments: command line of ROS, with name, namespace and parameters of the node.

    Raises:
        ParameterError: if a parameter has a value that cannot be used.
        StartError: if ROS or the node cannot start with the arguments.
        RuntimeError: if the drill cannot start, or fails.
    """
    with StopRequest() as stop:
        try:
            start_ros(ros_arguments)
            try:
                node = DrillNode()
            # rcl's errors are RuntimeErrors; ParameterException is of use_sim_time, which rclpy
            # declares.
            except (ParameterException, RuntimeError) as error:
                raise StartError(str(error)) from error
            spin(node, stop)
        finally:
            rclpy.try_shutdown()


def spin(
    node: DrillNode,
    stop: StopRequest,
    show: Callable[[Report | None], None] = lambda report: None,
) -> None:
    """Drill until the stop is requested or the node has finished.

    Args:
        node: of the drill.
        stop: the request.
        show: called several times a second with the latest report.

    Raises:
        RuntimeError: if the drill cannot start, or fails.
    """
    executor = MultiThreadedExecutor(_THREADS)
    executor.add_node(node)
    try:
        node.start()
        while not (stop.requested or node.finished):
            serve(executor, node.refuse_request)
            show(node.report)
    finally:
        node.stop()
        executor.shutdown(timeout_sec=1.0)
    if node.failure is not None:
        raise RuntimeError(str(node.failure)) from node.failure
