"""Connection of a client to one drill: how to find it, call it, and wait for its answer."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Drive, Feed, Status, WeightOnBit
from rpud_msgs.srv import (
    ClearFault,
    GetDelivery,
    GetSimulationState,
    InjectFault,
    ListFaults,
    ResetSimulation,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from rpud_sim.ros.client.arguments import SECONDS
from rpud_sim.ros.client.drill_search import no_drill, node_name
from rpud_sim.ros.client.drill_watch import DrillWatch
from rpud_sim.ros.client.errors import NoAnswerError, NoDrillError, RefusedError
from rpud_sim.ros.client.listening_node import ListeningNode
from rpud_sim.ros.client.topic_lookup import (
    absolute_name,
    listening_qos,
    offers_of_topic,
    types_of_topic,
)
from rpud_sim.ros.graph import message_class

_COMMANDS = {"weight_on_bit": WeightOnBit, "drive": Drive, "feed": Feed}
_COMMAND_DEPTH = 100
_SERVICES = {
    "inject_fault": InjectFault,
    "clear_fault": ClearFault,
    "list_faults": ListFaults,
    "engage": SetBool,
    "simulation/get_delivery": GetDelivery,
    "simulation/set_state": SetSimulationState,
    "simulation/step": StepSimulation,
    "simulation/run_to": RunToTime,
    "simulation/reset": ResetSimulation,
}

Value = TypeVar("Value")


class DrillConnection:
    """Publishers, clients and subscriptions of one drill; it waits ``patience`` for answers [s]."""

    def __init__(
        self, namespace: str, domain_id: int | None, node_name: str, patience: float
    ) -> None:
        self._patience = float(SECONDS.check("patience", patience))
        self.listening = ListeningNode(node_name, namespace, domain_id)  # node of the client
        self.watch = DrillWatch(self.listening)  # what the drill says
        self._found = False
        # The drill returns the headers of commands: so this client knows its own.
        self._mark, self._commands = f"{node_name}-{secrets.token_hex(4)}", 0
        self._publishers: dict[str, Publisher] = {}
        self._clients = {
            name: self.node.create_client(kind, name) for name, kind in _SERVICES.items()
        }

    @property
    def node(self) -> Node:
        return self.listening.node

    @property
    def namespace(self) -> str:
        return str(self.node.get_namespace())

    @property
    def status(self) -> Status:
        self.find()
        assert self.watch.status is not None  # a drill that is found has one
        return self.watch.status

    def find(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status, within a patience [s]."""
        if self._found:
            return
        patience = self._patience if patience is None else float(patience)
        services = [self._clients[name] for name in _SERVICES]
        try:
            self.listening.until(
                lambda: all(client.service_is_ready() for client in services), patience, ""
            )
        except NoAnswerError:
            domain = self.listening.domain_id
            raise NoDrillError(no_drill(self.node, self.namespace, domain, patience)) from None
        self._introduce(patience)
        try:
            self.listening.until(lambda: self.watch.status, patience, "")
        except NoAnswerError:
            raise NoDrillError(
                f"the drill in {self.namespace} published no status within {patience:g} s: it is "
                "still starting, or waits for the transition configure"
            ) from None
        self.watch.check_alone()
        self._found = True

    def until(
        self, condition: Callable[[], Value], what: str, patience: float | None = None
    ) -> Value:
        limit = self._patience if patience is None else float(patience)
        return self.listening.until(condition, limit, what)

    def command(self, name: str, message: Any) -> None:
        """Publish a command by its topic, and wait until the drill has accepted it."""
        self.find()
        publisher = self._publisher(name)
        self._commands += 1
        frame = message.header.frame_id = f"{self._mark}/{self._commands}"
        result = self.watch.result_of(lambda: publisher.publish(message), frame, self._patience)
        if not result.accepted:
            raise RefusedError(result.reason)

    def _publisher(self, name: str) -> Publisher:
        """Return the publisher of a command, which the drill hears.

        It is made for the first command: the drill warns of several publishers, and a client that
        only watches must not be one of them.
        """
        if name not in self._publishers:
            topic = f"command/{name}"
            publisher = self.node.create_publisher(_COMMANDS[name], topic, _COMMAND_DEPTH)
            self._introduce(self._patience)
            self._publishers[name] = publisher
            self.until(lambda: self._is_heard(publisher), f"the drill did not subscribe to {topic}")
        return self._publishers[name]

    def _is_heard(self, publisher: Publisher) -> bool:
        """Return whether the drill is among the subscribers, and all are connected."""
        infos = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        # One that asks for messages from before, which a command never has, is not connected.
        volatile = DurabilityPolicy.VOLATILE
        names = [node_name(info) for info in infos if info.qos_profile.durability == volatile]
        drills = {name for name in self.watch.publishers if name}
        return not drills.isdisjoint(names) and publisher.get_subscription_count() >= len(names)

    def call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service of the drill and return its response.

        With ``repeat`` it is sent again and again; not if it must act only once. While the drill
        publishes its status it is alive, and the wait goes on.
        """
        self.find()
        return self.listening.call(
            self._clients[name], request, self._patience, lambda: self.watch.statuses, repeat
        )

    def call_node(self, name: str, kind: Any, request: Any) -> Any:
        """Call a service that every node has, such as ``list_parameters``, repeatedly if needed."""
        self.find()
        nodes = self.until(
            lambda: [node for node in self.watch.publishers if node],
            "the name of the drill's node was not discovered",
        )
        full_name = f"{nodes[0]}/{name}"
        if full_name not in self._clients:
            self._clients[full_name] = self.node.create_client(kind, full_name)
            self._introduce(self._patience)
        return self.call(full_name, request, repeat=True)

    def listen(
        self, topic: str, kind: Any, qos: QoSProfile | None, patience: float | None
    ) -> list[Any]:
        self.find()
        name = absolute_name(self.node, topic)
        if kind is None:
            types = self.until(
                lambda: types_of_topic(self.node, name), f"no publisher on {name}", patience
            )
            kind = message_class(types[0])
        if qos is None:
            qos = listening_qos(offers_of_topic(self.node, name))
        heard: list[Any] = []
        self.listening.subscribe(kind, name, heard.append, qos)
        self._introduce(self._patience)
        return heard

    def _introduce(self, patience: float) -> None:
        """Wait until the drill has discovered all subscriptions and clients of this node.

        Discovery reports them in the order in which they were made: an answer to the last one
        shows that the drill knows all. Otherwise it could drop a response or the first messages.
        """
        last = self.node.create_client(GetSimulationState, "simulation/get_state")
        try:
            self.listening.call(last, GetSimulationState.Request(), patience, repeat=True)
        finally:
            self.node.destroy_client(last)
