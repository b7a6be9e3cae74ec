"""Requests and commands of a client to one drill, and their results."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from math import inf
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.client import Client
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rpud_msgs import msg, srv
from std_srvs.srv import SetBool

from rpud_sim.foundation.time import SECOND, split_seconds
from rpud_sim.ros.client.listening_node import SECONDS, ListeningNode, RefusedError, drill_nodes
from rpud_sim.ros.graph import RepeatedRequest, node_name

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
            self.introduce()

    def call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service, again and again with ``repeat``; a refusal is a RefusedError."""
        response = self._answer(self._clients[name], request, repeat)
        result = getattr(response, "result", response)
        if isinstance(result, msg.Result):
            if result.result not in (result.RESULT_OK, _ALREADY):
                raise RefusedError(result.error_message, result.result)
        elif isinstance(result, SetParametersResult):
            if not result.successful:
                raise RefusedError(result.reason)
        elif not getattr(result, "success", True):
            raise RefusedError(result.message)
        return response

    def introduce(self, patience: float | None = None) -> None:
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
        self._services.introduce()
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


def to_time(kind: Any, name: str, seconds: Any) -> Any:
    """Return seconds as a ``Time`` or ``Duration``; others than those are a ParameterError."""
    total = min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1)
    sec, nanosec = split_seconds(total)
    return kind(sec=sec, nanosec=nanosec)
