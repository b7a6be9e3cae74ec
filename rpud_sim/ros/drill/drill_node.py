"""Managed node of the drill: docs/reference lists its topics, services and parameters."""

from __future__ import annotations

import contextlib
import gc
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import MultiThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.validate_namespace import validate_namespace

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.commands import CommandTopics, Inbox
from rpud_sim.ros.drill.health import REPORT_PERIOD, Report
from rpud_sim.ros.drill.managed_node import (
    DrillParameters,
    DuplicateNodes,
    ManagedNode,
    NameHold,
    log_exceptions,
)
from rpud_sim.ros.drill.pacing_loop import LAST_RESPONSE, PacingLoop
from rpud_sim.ros.drill.services import DeliveryServer, DrillServices, offer_standard_services
from rpud_sim.ros.drill.session import Session
from rpud_sim.ros.environment import StartError
from rpud_sim.ros.process import StopRequest, limit_end, limited_end, running_ros
from rpud_sim.ros.threads import RequestError, quick_switches, serve
from rpud_sim.ros.waiting import OwnGroup, ServiceThread
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.faults import FaultRecord
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Plan

NAME = "drill_node"
_THREADS = 2  # a short request, and whatever else comes; steps have their own
_LAST_ANSWERS = 10.0  # time for answers that are under way when the drill ends [s]

_DISCOVERY_TIME = 5.0  # that the middleware may take to connect a recorder's subscriptions [s]


class DrillNode(ManagedNode):
    """A drill in soft real time: a managed node that activates itself by default.

    Simulation time begins when it is first activated, or where a ``plan`` continues live. It ends
    after ``duration`` [s] or when the node is cleaned up.
    """

    def __init__(
        self, duration: float | None = None, plan: Plan | None = None, **options: Any
    ) -> None:
        super().__init__(NAME, **options)
        try:
            self._set_up(duration, plan, options.get("cli_args") or ())
        except BaseException:
            super().destroy_node()  # or the topic of its transitions would stay in the graph
            raise

    def _set_up(self, duration: float | None, plan: Plan | None, words: Sequence[str]) -> None:
        self.loop = PacingLoop()
        self._plan = plan
        self._drill_parameters = DrillParameters(self, self._apply_settings, self._fixed, words)
        Beginning.drawn(self.settings)  # a missing scenario ends the start, not the activation
        begin = plan.live_from if plan else 0
        self._end = sys.maxsize if duration is None else begin + round(duration * SECOND)
        self._inbox = Inbox(self.get_logger(), self.loop.wake)
        self._duplicates = DuplicateNodes(self)
        self._unrecorded: Mapping[str, int] = {}  # messages before ``await_recorder``, by topic
        CommandTopics(self, self._inbox, lambda: self.settings, self._now, self._origin)
        services = DrillServices(self, self.loop, lambda: self.settings)
        offer_standard_services(self, services)
        DeliveryServer(self, self.loop)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(REPORT_PERIOD, self._report_before_start, clock=steady)

    @property
    def settings(self) -> Settings:
        return self._drill_parameters.settings

    @property
    def report(self) -> Report | None:
        """The latest report, None before the first."""
        return session.reporter.last if (session := self.loop.session) else None

    @property
    def totals(self) -> Metrics:
        """Metrics since the start; to be read when it has stopped."""
        return session.reporter.totals if (session := self.loop.session) else Metrics()

    @property
    def faults(self) -> tuple[FaultRecord, ...]:
        """Faults since the start; to be read when it has stopped."""
        return session.run.simulation.faults.records if (session := self.loop.started) else ()

    @property
    def sent(self) -> Mapping[str, int]:
        """Messages of each topic of its namespace, by absolute name, since ``await_recorder``."""
        published = session.publishers.published if (session := self.loop.session) else {}
        return {
            self.resolve_topic_name(name): count - self._unrecorded.get(name, 0)
            for name, count in published.items()
        }

    def await_recorder(self, stop: StopRequest) -> None:
        """Wait until every topic has a subscriber, log which have none, and publish all of them."""
        if (session := self.loop.session) is None:
            return
        publishers, end = session.publishers, time.monotonic() + _DISCOVERY_TIME
        own = publishers.own
        while (unsubscribed := own.unsubscribed) and time.monotonic() < end and not stop.wait(0.01):
            pass
        if unsubscribed and not stop.requested:
            self.get_logger().warning(f"not subscribed by the recorder: {', '.join(unsubscribed)}")
        publishers.complete = True
        self._unrecorded = publishers.published

    def prepare(self) -> None:
        """Configure, with ``autostart`` and unless it has: its topics are there then."""
        if self.settings.autostart and self.loop.session is None:
            _complete(self.trigger_configure)

    def start(self) -> None:
        self.prepare()
        if self.settings.autostart:
            _complete(self.trigger_activate)
        else:
            self.get_logger().info("waiting for the transitions configure and activate")

    def stop(self) -> None:
        """End the drilling, publish the last status, and let listeners have the last messages."""
        self.loop.stop()

    @log_exceptions
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Prepare everything; nothing moves yet."""
        compile_kernels(self.settings.configuration.parameters, self.get_logger().info)
        session = Session(
            *(self, self.settings, self._inbox, self._duplicates, self._drill_parameters.restore),
            *(self._end, self._plan),
        )
        self.loop.configure(session)
        # A garbage collection of all that lives by now would make blocks late.
        gc.collect()
        gc.freeze()
        return TransitionCallbackReturn.SUCCESS

    @log_exceptions
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let commands act; simulation time begins, if this is the first time."""
        if self.loop.started is None:
            self.loop.start(self.settings)
        else:
            self._let_commands_act(True)
        self._inbox.opened = True
        self.get_logger().info("the drill is active")
        return TransitionCallbackReturn.SUCCESS

    @log_exceptions
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make drive and weight on bit zero; the drill continues without them."""
        self._inbox.opened = False
        self._let_commands_act(False)
        return TransitionCallbackReturn.SUCCESS

    @log_exceptions
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._inbox.opened = False
        self.loop.clean_up()
        gc.unfreeze()
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove what a failed transition has left; it can be configured again."""
        return self.on_cleanup(state)

    @log_exceptions
    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._inbox.opened = False
        self.loop.quit()
        return TransitionCallbackReturn.SUCCESS

    def destroy_node(self) -> None:
        """Destroy the node; another process of this machine may have its name then."""
        self._duplicates.close()
        super().destroy_node()

    def refuse_request(self, reason: str) -> None:
        self._inbox.refuse_request(reason)

    def _let_commands_act(self, active: bool) -> None:
        self.loop.request(lambda session: session.activate(active))

    def _report_before_start(self) -> None:
        if (session := self.loop.session) is None:
            self._duplicates.count()
        elif self.loop.started is None:
            session.announce()

    def _now(self) -> int:
        if self.settings.publish_clock and (session := self.loop.session) is not None:
            return session.stamp
        return int(self.get_clock().now().nanoseconds)

    def _origin(self) -> int:
        return session.run.origin if (session := self.loop.session) is not None else 0

    def _fixed(self) -> str:
        """Return why parameters that are not changeable cannot be set now; empty if they can."""
        if self._plan is not None:
            return "is read-only in a fork"
        return "is read-only until the drill is cleaned up" if self.loop.session else ""

    def _apply_settings(self, settings: Settings) -> None:
        if (session := self.loop.started) is not None and session.settings != settings:
            with contextlib.suppress(RequestError):  # there is nothing left to change
                # By then the settings may be later ones, of a reset.
                self.loop.request(lambda session: session.configure(self.settings))


def _complete(trigger: Callable[[], TransitionCallbackReturn]) -> None:
    if trigger() != TransitionCallbackReturn.SUCCESS:
        raise RuntimeError("the drill cannot be started; see its log")


def drill(ros_arguments: Sequence[str], with_parent: bool = False) -> None:
    """Run a drill with a command line of ROS until a signal, or the end of its node or parent."""
    with StopRequest(with_parent) as stop, running_ros(ros_arguments):
        try:
            try:
                node = DrillNode(cli_args=list(ros_arguments))
            except RuntimeError as error:  # of rcl
                raise StartError(str(error)) from error
            spin(node, stop)
        finally:
            limit_end()


def spin(
    node: DrillNode,
    stop: StopRequest,
    show: Callable[[Report | None], None] = lambda report: None,
) -> None:
    """Drill until the stop is requested or the node has finished; ``show`` gets reports."""
    executor = MultiThreadedExecutor(_THREADS)
    executor.add_node(node)
    steps = [each for each in node.services if isinstance(each.callback_group, OwnGroup)]
    stepping = ServiceThread(node.context, steps, node.refuse_request)
    try:
        node.start()
        with quick_switches():
            while not (stop.requested or node.loop.finished):
                serve(executor, node.refuse_request)
                show(node.report)
        if stop.orphaned:
            node.get_logger().warning("parent process exited; shutting down")
    finally:
        with limited_end():
            session = node.loop.started
            answering = session is not None and session.timeline.goal is not None
            node.stop()
            # Against its word, rclpy's shutdown does not wait for callbacks that are under way.
            executor._work_tracker.wait(_LAST_ANSWERS)
            stepping.close(_LAST_ANSWERS)
            if answering:  # a client drops the response of a node that it knows to have left
                time.sleep(LAST_RESPONSE)
            executor.shutdown()
    if (failure := node.loop.failure) is not None:
        raise RuntimeError(str(failure)) from failure


@contextmanager
def open_drill(
    values: Mapping[str, Any],
    namespace: str,
    duration: float | None = None,
    *,
    allow_duplicate: bool = False,
    plan: Plan | None = None,
) -> Iterator[DrillNode]:
    """Start ROS and a drill node with these parameters; shut both down at the end.

    Beside a drill of the same name it is a StartError, unless ``allow_duplicate``.
    ``duration`` is in simulation time [s].
    """
    with running_ros():
        validate_namespace(f"/{namespace.removeprefix('/')}")
        name = f"/{namespace.strip('/')}/{NAME}".replace("//", "/")
        hold = NameHold(name, rclpy.get_default_context().get_domain_id())
        try:
            if hold.taken and not allow_duplicate:
                raise StartError(
                    f"a drill named {name} runs already: choose another --namespace, "
                    "or give --allow-duplicate",
                    1,
                )
            overrides = [Parameter(name, value=value) for name, value in values.items()]
            yield DrillNode(duration, plan, namespace=namespace, parameter_overrides=overrides)
        finally:
            hold.release()
