"""Node of a client with its own context and executor, its errors, and the drills that it finds."""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import Callable
from itertools import chain
from math import inf
from typing import TYPE_CHECKING, Any, TypeVar

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.client import Client
from rclpy.event_handler import EventHandler
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs import msg, srv
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ExpectedError, did_you_mean
from rpud_sim.ros.client.arguments import SECONDS
from rpud_sim.ros.graph import RepeatedRequest, node_name, resolve_topic
from rpud_sim.ros.process import name_error, start_ros
from rpud_sim.ros.received import ReceivedTopic, Sink
from rpud_sim.ros.threads import raised
from rpud_sim.ros.waiting import WaitSet, take_responses

if TYPE_CHECKING:
    from typing_extensions import Self

PATIENCE = 10.0  # time limit of a client, unless it is given another one [s]
POLL_PERIOD = 0.02  # between looks at the graph, which wakes no executor [s]
_REFRESH_PERIOD = 0.5  # between looks at the publishers [s]
_STEP = "/simulation/step"
_STEP_TYPE = "rpud_msgs/srv/StepSimulation"

Value = TypeVar("Value")


class ClientError(ExpectedError, RuntimeError):
    """A command that did not succeed."""


class RefusedError(ClientError):
    """Rejection of the drill, with its reason; ``result`` is a number of ``rpud_msgs/Result``."""

    def __init__(self, reason: str, result: int | None = None) -> None:
        super().__init__(reason)
        self.result = result


class NoDrillError(ClientError):
    """No drill in the namespace, or more than one."""


class NoAnswerError(ClientError, TimeoutError):
    """Nothing came within the time limit."""


class ListeningNode:
    """Node that takes messages while its owner waits, for ``patience`` at most [s]."""

    patience: float
    node: Node

    def __init__(
        self,
        name: str,
        namespace: str,
        domain_id: int | None = None,
        patience: float = PATIENCE,
    ) -> None:
        self.patience = float(SECONDS.check("patience", patience))
        self._topics: list[ReceivedTopic] = []
        self._looked_at = time.monotonic()
        self._check: Callable[[], object] = lambda: None
        self._context = rclpy.Context()
        start_ros(context=self._context, domain_id=domain_id)
        try:
            self.node = rclpy.create_node(
                name,
                namespace=namespace,
                context=self._context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
        except NameValidationException as error:
            rclpy.shutdown(context=self._context)
            raise name_error(error) from error
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._served_at = time.monotonic()  # when the executor had its turn
        self._first_others = self._count_others()
        self._waiting = WaitSet(self._context)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def domain_id(self) -> int:
        return int(self._context.get_domain_id())

    def check_while_waiting(self, check: Callable[[], object]) -> None:
        """Call this while a method waits; an error that it raises ends the wait."""
        self._check = check

    def close(self) -> None:
        """Leave the graph."""
        if self._context.ok():
            self._executor.shutdown()
            self.node.destroy_node()
            rclpy.shutdown(context=self._context)

    def subscribe(
        self, kind: Any, topic: str, sink: Sink, qos: QoSProfile | None = None
    ) -> ReceivedTopic:
        """Subscribe to a topic, whose messages ``sink`` takes; see ``ReceivedTopic``."""
        name = resolve_topic(self.node, topic)
        self._topics.append(received := ReceivedTopic(self.node, name, kind, sink, qos))
        return received

    def spin(self, seconds: float = 0.0) -> None:
        """Take messages, responses and events that have arrived, or wait for the next one [s]."""
        self._check()
        if time.monotonic() >= self._looked_at + _REFRESH_PERIOD:
            self._looked_at = time.monotonic()
            for topic in self._topics:
                if topic.has_other_offers():
                    topic.renew()
        clients = list(self.node.clients)
        subscriptions = [topic.subscription for topic in self._topics]
        arrived = self._waiting.wait(seconds, subscriptions, clients)
        for topic in self._topics:
            if topic.subscription in arrived:
                self._guarded(topic.take)
        for client in clients:
            if client in arrived:
                self._guarded(take_responses, client)
        period = POLL_PERIOD if self._has_more() else _REFRESH_PERIOD
        if not arrived or time.monotonic() >= self._served_at + period:
            # Seldom: its turn makes a wait set from every entity of the node, in Python.
            self._served_at = time.monotonic()
            self._guarded(self._executor.spin_once, 0.0)

    def _has_more(self) -> bool:
        """Return whether the owner of the node has made what the executor alone serves.

        Otherwise it serves events, which are logged, and questions about types.
        """
        subscriptions = sum(1 for _ in self.node.subscriptions)
        return subscriptions > len(self._topics) or self._count_others() > self._first_others

    def _count_others(self) -> int:
        node = self.node
        waitables = (each for each in node.waitables if not isinstance(each, EventHandler))
        return sum(1 for _ in chain(node.timers, node.services, waitables))

    def take(self) -> None:
        """Take all messages that have arrived, without a wait; responses and events stay."""
        for topic in self._topics:
            self._guarded(topic.take)

    def _guarded(self, act: Callable[..., object], *arguments: Any) -> None:
        try:
            act(*arguments)
        except RuntimeError as error:  # rclpy raises it at a malformed message
            self.node.get_logger().warning(raised(error))

    def wait_until(
        self,
        condition: Callable[[], Value | None],
        what: str,
        patience: float | None = None,
        alive: Callable[[], int] = lambda: 0,
    ) -> Value:
        """Take messages until a condition holds, and return its value, or raise a NoAnswerError.

        The patience begins again whenever the number of ``alive`` is another one.
        """
        patience = self.patience if patience is None else float(patience)
        deadline, number = time.monotonic() + patience, alive()
        while not (value := condition()):
            if alive() != number:
                deadline, number = time.monotonic() + patience, alive()
            if time.monotonic() >= deadline:
                raise NoAnswerError(f"{what} within {patience:g} s")
            self.spin(POLL_PERIOD)
        return value


class DrillFinder(ListeningNode):
    """Node that knows the drills of a domain; it never waits. Use it from one thread."""

    def __init__(self, domain_id: int | None = None) -> None:
        super().__init__("rpud_watch_list", "/", domain_id)

    def drills(self) -> list[str]:
        """Return the namespaces of the drills."""
        self.take()
        return drill_namespaces(self.node)


def drill_namespaces(node: Node) -> list[str]:
    """Return the namespaces in which there are drills, as far as the node has discovered them."""
    return sorted(
        name.removesuffix(_STEP) or "/"
        for name, types in node.get_service_names_and_types()
        if name.endswith(_STEP) and _STEP_TYPE in types
    )


def drill_nodes(node: Node) -> list[str]:
    """Return the nodes that publish a status in a node's namespace; empty where not known yet."""
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name("status"))
    return [node_name(info) for info in infos if info.topic_type == "rpud_msgs/msg/Status"]


def no_drill(node: Node, namespace: str, domain_id: int, patience: float) -> str:
    """Return the line of an error: no drill in a namespace, and where there are some."""
    others = [each for each in drill_namespaces(node) if each != namespace]
    where = "there is none in the whole domain: `rpud run` starts one, or its ROS_DOMAIN_ID differs"
    if server := os.environ.get("ROS_DISCOVERY_SERVER"):
        where += f", or there is no server at ROS_DISCOVERY_SERVER={server:.80}"
    if others:
        where = (
            f"there is one in {', '.join(others)}{did_you_mean(namespace, others, others=False)}"
        )
    return f"no drill in {namespace} of ROS domain {domain_id} within {patience:g} s; {where}"


_SERVICES = {
    "inject_fault": srv.InjectFault,
    "clear_fault": srv.ClearFault,
    "list_faults": srv.ListFaults,
    "engage": SetBool,
    "simulation/get_delivery": srv.GetDelivery,
    "simulation/set_state": srv.SetSimulationState,
    "simulation/step": srv.StepSimulation,
    "simulation/run_to": srv.RunToTime,
    "simulation/reset": srv.ResetSimulation,
}
_ALREADY = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
_REPETITION = 2.0  # of a request that may be repeated [s]
_COMMAND_DEPTH = 100


class ServiceCaller:
    """Clients of the drill's services; patience begins again when the number of ``alive`` grows."""

    def __init__(self, listening: ListeningNode, alive: Callable[[], int]) -> None:
        self._listening = listening
        self._alive = alive
        self._clients = {
            name: listening.node.create_client(kind, name) for name, kind in _SERVICES.items()
        }

    def add(self, kind: Any, name: str) -> None:
        """Make the client of a further service, unless it is there."""
        if name not in self._clients:
            self._clients[name] = self._listening.node.create_client(kind, name)
            self.wait_until_discovered()

    def call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service, again and again with ``repeat``; a rejection is a RefusedError."""
        response = self._answer(self._clients[name], request, repeat)
        result = getattr(response, "result", response)
        if isinstance(result, msg.Result):
            if result.result not in (result.RESULT_OK, _ALREADY):
                raise RefusedError(result.error_message, result.result)
        elif isinstance(result, SetParametersResult):
            if not result.successful:
                raise RefusedError(result.reason)
        elif not getattr(result, "success", True):
            raise RefusedError(getattr(result, "message", "see the log of the drill"))
        return response

    def wait_until_discovered(self, patience: float | None = None) -> None:
        """Wait until the drill has discovered all subscriptions and clients of this node.

        Discovery reports them in the order in which they were made: it answers the last one.
        """
        node, kind = self._listening.node, srv.GetSimulationState
        last = node.create_client(kind, "simulation/get_state")
        try:
            self._answer(last, kind.Request(), True, patience)
        finally:
            node.destroy_client(last)

    def _answer(
        self, client: Client, request: Any, repeat: bool, patience: float | None = None
    ) -> Any:
        wait_until = self._listening.wait_until
        service = self._listening.node.resolve_service_name(client.srv_name)
        wait_until(client.service_is_ready, f"service {service} did not appear", patience)
        sent = RepeatedRequest(client, request, _REPETITION if repeat else inf)
        what = f"service {service} did not answer"
        try:
            return wait_until(sent.answered, what, patience, self._alive).result()
        finally:
            sent.close()


class CommandSender:
    """Publishers of commands; the drill returns their headers with the results."""

    def __init__(
        self,
        listening: ListeningNode,
        services: ServiceCaller,
        status_number: Callable[[], int],
    ) -> None:
        self._listening = listening
        self._node = listening.node
        self._services = services
        self._status_number = status_number
        self._mark, self._count = f"{self._node.get_name()}-{secrets.token_hex(4)}", 0
        self._awaited = self._mark  # frame of the command whose result is awaited
        # At most one: the result, and the number of the status that shows it.
        self._results: list[tuple[Any, int]] = []
        self._publishers: dict[str, Publisher] = {}

    def take(self, message: msg.CommandResults) -> None:
        """Take the results of commands, of any client."""
        for result in message.results:
            if result.header.frame_id == self._awaited and not self._results:
                self._results.append((result, message.status))

    def send(self, name: str, message: Any) -> None:
        """Publish a command by its topic, and wait until the status shows that it is accepted."""
        if name not in self._publishers:
            self._publishers[name] = self._publisher(type(message), name)
        self._count += 1
        self._awaited = message.header.frame_id = f"{self._mark}/{self._count}"
        self._results.clear()
        self._publishers[name].publish(message)
        until, what = self._listening.wait_until, "the drill did not accept the command"
        [(result, shown)] = until(lambda: self._results, what)
        until(lambda: self._status_number() >= shown, what)
        if not result.accepted:
            raise RefusedError(result.reason)

    def _publisher(self, kind: Any, name: str) -> Publisher:
        """Return a publisher of a command that the drill has discovered, made for the first one."""
        topic = f"command/{name}"
        publisher = self._node.create_publisher(kind, topic, _COMMAND_DEPTH)
        self._services.wait_until_discovered()
        self._listening.wait_until(
            lambda: self._is_discovered(publisher), f"the drill did not subscribe to {topic}"
        )
        return publisher

    def _is_discovered(self, publisher: Publisher) -> bool:
        """Return whether the drill is among the subscribers, and all are connected."""
        infos = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
        # One that asks for messages from before, which a command never has, is not connected.
        volatile = DurabilityPolicy.VOLATILE
        names = [node_name(info) for info in infos if info.qos_profile.durability == volatile]
        drills = set(filter(None, drill_nodes(self._node)))
        return not drills.isdisjoint(names) and publisher.get_subscription_count() >= len(names)
