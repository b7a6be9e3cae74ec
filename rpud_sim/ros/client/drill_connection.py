"""Connection of a client to one drill: how to find it, call it, and know what it says."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

from rclpy.client import Client
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs import msg, srv
from rpud_msgs.msg import Fault, Status
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.ros.client.drill_finder import no_drill
from rpud_sim.ros.client.listening_node import (
    POLL_PERIOD,
    ListeningNode,
    NoAnswerError,
    NoDrillError,
    RefusedError,
)
from rpud_sim.ros.client.topic_listener import TopicListener
from rpud_sim.ros.graph import node_name

SECONDS = Quantity("s", "a duration", 0.0, 2.0**31, below=True)

_COMMANDS = {"weight_on_bit": msg.WeightOnBit, "drive": msg.Drive, "feed": msg.Feed}
_COMMAND_DEPTH = 100
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
_HEARD = {
    "status": Status,
    "faults": msg.Faults,
    "journal": msg.JournalEntry,
    "command_results": msg.CommandResults,
}
_LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_STATUS_PERIOD = 2.5  # in which every living drill publishes a status, at any load [s]
_REPETITION = 2.0  # of a request that may be repeated [s]

Value = TypeVar("Value")


class DrillConnection:
    """Node that has found one drill, hears what it says and can call it."""

    def __init__(
        self, namespace: str, domain_id: int | None, node_name: str, patience: float
    ) -> None:
        self._patience = float(SECONDS.check("patience", patience))
        self._listening = ListeningNode(node_name, namespace, domain_id)
        self._found = False
        self._latest: dict[str, Any] = {}  # message by topic
        self._numbers = deque([0], maxlen=100)  # of the latest statuses, by their publisher
        self._observer: Callable[[str, Any], object] = lambda topic, message: None
        # The drill returns the headers of commands: so this client knows its own.
        self._mark, self._commands = f"{node_name}-{secrets.token_hex(4)}", 0
        self._awaited = self._mark  # frame of the command whose result is awaited
        # At most one: the result, and the number of the status that shows it.
        self._results: list[tuple[Any, int]] = []
        self._publishers: dict[str, Publisher] = {}
        for topic, kind in _HEARD.items():
            self._listening.subscribe(kind, topic, partial(self._hear, topic), _LATCHED)
        self._clients = {
            name: self.node.create_client(kind, name) for name, kind in _SERVICES.items()
        }

    def close(self) -> None:
        """Leave the graph."""
        self._listening.close()

    # What the drill is and says.

    @property
    def node(self) -> Node:
        """Node of the client, for publishers and services of your own."""
        return self._listening.node

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return str(self.node.get_namespace())

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the drill's status; no node, no drill."""
        topic = self.node.resolve_topic_name("status")
        infos = self.node.get_publishers_info_by_topic(topic)
        return [node_name(info) for info in infos if info.topic_type == "rpud_msgs/msg/Status"]

    @property
    def status(self) -> Status:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        self.found()
        return self._latest["status"]

    @property
    def status_number(self) -> int:
        """Number that the drill's publisher has given to the latest status; 0 before the first."""
        return self._numbers[-1]

    @property
    def faults(self) -> list[Fault]:
        """Faults since the start, those that last and those that are over, by number."""
        self.until(lambda: "faults" in self._latest, what="no list of faults came")
        return list(self._latest["faults"].faults)

    # Waiting and listening.

    def found(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status.

        Every other method does this first. ``patience`` is in s; None for that of the client. A
        drill that has never run on a machine may compile for a minute.
        """
        if self._found:
            return
        patience = self._limit(patience)
        try:
            self._introduce(patience)
        except NoAnswerError:
            domain = self._listening.domain_id
            raise NoDrillError(no_drill(self.node, self.namespace, domain, patience)) from None
        try:
            self._listening.until(lambda: "status" in self._latest, patience, "")
        except NoAnswerError:
            raise NoDrillError(
                f"the drill in {self.namespace} published no status within {patience:g} s: it is "
                "still starting, or waits for the transition configure"
            ) from None
        self._check_alone()
        self._found = True

    def until(
        self,
        condition: Callable[[], Value],
        patience: float | None = None,
        what: str = "the condition did not hold",
    ) -> Value:
        """Take messages until a condition holds, and return its value.

        It is looked at after each message. ``patience`` is real time [s]; None for that of the
        client. ``what`` is a sentence for the error, without the limit.
        """
        self.found()
        return self._listening.until(condition, self._limit(patience), what)

    def check_while_waiting(self, check: Callable[[], object]) -> None:
        """Call this while a method waits; an error that it raises ends the wait.

        A test that has started the drill knows at once that the drill has died.
        """
        self._listening.check = check

    def take(self) -> None:
        """Take all messages that have arrived, without a wait; responses and events stay."""
        self._listening.settle()

    def spin(self, seconds: float = 0.0) -> None:
        """Take messages, responses and events that have arrived, or wait for the next one [s]."""
        self._listening.spin(seconds)

    def listen(
        self,
        topic: str,
        kind: Any = None,
        qos: QoSProfile | None = None,
        patience: float | None = None,
    ) -> list[Any]:
        """Subscribe to a topic of any node, and return the list that its messages are added to.

        A relative name is one of the drill's namespace. ``kind`` is the class of the messages; None
        for that with which it is published. ``qos`` is what the publishers offer if it is None.
        ``patience`` limits the wait for the topic [s]; None for that of the client.
        """
        self.found()
        listener = TopicListener(self._listening, topic, self._limit(patience), kind, qos)
        self._introduce(self._patience)
        return listener.messages

    def observe(self, observer: Callable[[str, Any], object]) -> None:
        """Call a function with the name and each message of some topics.

        These are ``status``, ``faults``, ``journal`` and ``command_results``. They are latched:
        what came before is not repeated. Observe before the client has waited.
        """
        self._observer = observer

    def _hear(self, topic: str, message: Any, info: dict[str, Any]) -> None:
        self._latest[topic] = message
        if topic == "status":
            self._numbers.append(info["publication_sequence_number"])
        elif topic == "command_results":
            for result in message.results:
                if result.header.frame_id == self._awaited and not self._results:
                    self._results.append((result, message.status))
        self._observer(topic, message)

    def _limit(self, patience: float | None) -> float:
        return self._patience if patience is None else float(patience)

    def _introduce(self, patience: float) -> None:
        """Wait until the drill has discovered all subscriptions and clients of this node.

        Discovery reports them in the order in which they were made: an answer to the last one
        shows that the drill knows all. Otherwise it could drop a response or the first messages.
        """
        last = self.node.create_client(srv.GetSimulationState, "simulation/get_state")
        try:
            self._answer(last, srv.GetSimulationState.Request(), patience, repeat=True)
        finally:
            self.node.destroy_client(last)

    def _check_alone(self) -> None:
        """Check that one drill alone is there; one that was killed counts for nothing."""
        # The middleware remembers a killed drill for 20 s. Only the numbers of living ones go on.
        deadline = time.monotonic() + _STATUS_PERIOD
        while len(names := self.publishers) > 1 and time.monotonic() < deadline:
            if any(after <= before for before, after in pairwise(self._numbers)):
                raise NoDrillError(
                    f"{len(names)} nodes publish {self.node.resolve_topic_name('status')} "
                    f"({', '.join(filter(None, names))}): all of them would answer; start each "
                    "drill in a namespace of its own"
                )
            self.spin(POLL_PERIOD)

    def _call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service of the drill and return its response.

        With ``repeat`` it is sent again and again, since a server drops a response for a client
        that it has not discovered yet; not if it must act only once.
        """
        self.found()
        return self._answer(self._clients[name], request, self._patience, repeat)

    def _answer(self, client: Client, request: Any, patience: float, repeat: bool) -> Any:
        service = self.node.resolve_service_name(client.srv_name)
        self._listening.until(
            client.service_is_ready, patience, f"service {service} did not appear"
        )
        futures = [client.call_async(request)]
        sent = alive = time.monotonic()
        number = self.status_number
        try:
            while not any(future.done() for future in futures):
                self.spin(POLL_PERIOD)
                now = time.monotonic()
                if self.status_number != number:  # the drill is alive: some requests take long
                    number, alive = self.status_number, now
                if now - alive >= patience:
                    raise NoAnswerError(f"service {service} did not answer within {patience:g} s")
                if repeat and now - sent >= _REPETITION:
                    futures.append(client.call_async(request))
                    sent = now
            return next(future.result() for future in futures if future.done())
        finally:
            for future in futures:
                client.remove_pending_request(future)

    def _command(self, name: str, message: Any) -> None:
        """Publish a command by its topic, and wait until the drill has accepted it."""
        self.found()
        if name not in self._publishers:
            self._publishers[name] = self._publisher(name)
        self._commands += 1
        self._awaited = message.header.frame_id = f"{self._mark}/{self._commands}"
        self._results.clear()
        self._publishers[name].publish(message)
        what = "the drill did not accept the command"
        result, shown = self.until(lambda: self._results, what=what)[0]
        self.until(lambda: self.status_number >= shown, what=what)
        if not result.accepted:
            raise RefusedError(result.reason)

    def _publisher(self, name: str) -> Publisher:
        """Return a publisher of a command, which the drill hears.

        It is made for the first command: the drill warns of several publishers, and a client that
        only watches must not be one of them.
        """
        topic = f"command/{name}"
        publisher = self.node.create_publisher(_COMMANDS[name], topic, _COMMAND_DEPTH)
        self._introduce(self._patience)
        what = f"the drill did not subscribe to {topic}"
        self.until(lambda: self._is_heard(publisher), what=what)
        return publisher

    def _is_heard(self, publisher: Publisher) -> bool:
        """Return whether the drill is among the subscribers, and all are connected."""
        infos = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        # One that asks for messages from before, which a command never has, is not connected.
        volatile = DurabilityPolicy.VOLATILE
        names = [node_name(info) for info in infos if info.qos_profile.durability == volatile]
        drills = set(filter(None, self.publishers))
        return not drills.isdisjoint(names) and publisher.get_subscription_count() >= len(names)
