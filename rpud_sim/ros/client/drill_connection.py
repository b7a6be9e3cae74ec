"""Connection of a client to one drill: how to find it, call it, and know what it says."""

from __future__ import annotations

import secrets
import time
from collections import deque
from collections.abc import Callable
from itertools import pairwise
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import (
    CommandResult,
    CommandResults,
    Drive,
    Fault,
    Faults,
    Feed,
    JournalEntry,
    Status,
    WeightOnBit,
)
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

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.ros.client.drill_finder import no_drill
from rpud_sim.ros.client.listening_node import (
    ListeningNode,
    NoAnswerError,
    NoDrillError,
    RefusedError,
)
from rpud_sim.ros.client.topic_listener import (
    absolute_name,
    listening_qos,
    offers_of_topic,
    types_of_topic,
)
from rpud_sim.ros.graph import message_class, node_name

SECONDS = Quantity("s", "a duration", 0.0, 2.0**31, below=True)

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
_STATUS_TYPE = "rpud_msgs/msg/Status"
_STATUS_PERIOD = 2.5  # in which every living drill publishes a status, at any load [s]
_LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_JOURNAL = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)

Value = TypeVar("Value")


class DrillConnection:
    """Node that has found one drill, hears what it says and can call it."""

    def __init__(
        self, namespace: str, domain_id: int | None, node_name: str, patience: float
    ) -> None:
        self._patience = float(SECONDS.check("patience", patience))
        self._listening = ListeningNode(node_name, namespace, domain_id)
        self._latest: Status | None = None  # status, None before the first
        self._latest_faults: Faults | None = None  # None before the first
        self._statuses = 0  # count of the statuses that came
        self._observer: Callable[[str, Any], object] = lambda topic, message: None
        self._found = False
        self._sequence: deque[int] = deque(maxlen=100)  # publication numbers of the statuses
        # The drill returns the headers of commands: so this client knows its own.
        self._mark, self._commands = f"{node_name}-{secrets.token_hex(4)}", 0
        self._awaited = ""  # frame of the command whose result is awaited
        self._result: CommandResult | None = None  # of that command
        self._shown = 0  # number of the status that shows it
        self._publishers: dict[str, Publisher] = {}
        subscribe = self._listening.subscribe
        subscribe(Status, "status", self._on_status, _LATCHED)
        subscribe(Faults, "faults", self._on_faults, _LATCHED)
        subscribe(JournalEntry, "journal", lambda each: self._observer("journal", each), _JOURNAL)
        subscribe(CommandResults, "command_results", self._on_results, _LATCHED)
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
        return [node_name(info) for info in infos if info.topic_type == _STATUS_TYPE]

    @property
    def status(self) -> Status:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        self.found()
        assert self._latest is not None  # a drill that is found has one
        return self._latest

    @property
    def status_number(self) -> int:
        """Number that the drill's publisher has given to the latest status; 0 before the first."""
        return self._sequence[-1] if self._sequence else 0

    @property
    def faults(self) -> list[Fault]:
        """Faults since the start, those that last and those that are over, by number."""
        faults = self.until(lambda: self._latest_faults, what="no list of faults came")
        assert faults is not None  # until waits for it
        return list(faults.faults)

    # Waiting and listening.

    def found(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status.

        Every other method does this first. ``patience`` is in s; None for that of the client. A
        drill that has never run on a machine may compile for a minute.
        """
        if self._found:
            return
        patience = self._patience if patience is None else float(patience)
        services = [self._clients[name] for name in _SERVICES]
        try:
            self._listening.until(
                lambda: all(client.service_is_ready() for client in services), patience, ""
            )
        except NoAnswerError:
            domain = self._listening.domain_id
            raise NoDrillError(no_drill(self.node, self.namespace, domain, patience)) from None
        self._introduce(patience)
        try:
            self._listening.until(lambda: self._latest, patience, "")
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
        limit = self._patience if patience is None else float(patience)
        return self._listening.until(condition, limit, what)

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
        name = absolute_name(self.node, topic)
        if kind is None:
            types = self.until(
                lambda: types_of_topic(self.node, name), patience, f"no publisher on {name}"
            )
            kind = message_class(types[0])
        heard: list[Any] = []
        offered = qos or listening_qos(offers_of_topic(self.node, name))
        self._listening.subscribe(kind, name, heard.append, offered)
        self._introduce(self._patience)
        return heard

    def observe(self, observer: Callable[[str, Any], object]) -> None:
        """Call a function with the name and each message of some topics.

        These are ``status``, ``faults``, ``journal`` and ``command_results``. They are latched:
        what came before is not repeated. Observe before the client has waited.
        """
        self._observer = observer

    # For the commands.

    def _command(self, name: str, message: Any) -> None:
        """Publish a command by its topic, and wait until the drill has accepted it."""
        self.found()
        publisher = self._publisher(name)
        self._commands += 1
        self._awaited = message.header.frame_id = f"{self._mark}/{self._commands}"
        self._result = None
        publisher.publish(message)
        what = "the drill did not accept the command"
        result = self.until(lambda: self._result, what=what)
        assert result is not None  # until waits for it
        # The latest status shows it then.
        self.until(lambda: not self._sequence or self.status_number >= self._shown, what=what)
        if not result.accepted:
            raise RefusedError(result.reason)

    def _call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service of the drill and return its response.

        With ``repeat`` it is sent again and again; not if it must act only once. While the drill
        publishes its status it is alive, and the wait goes on.
        """
        self.found()
        return self._listening.call(
            self._clients[name], request, self._patience, lambda: self._statuses, repeat
        )

    def _call_node(self, name: str, kind: Any, request: Any) -> Any:
        """Call a service that every node has, such as ``list_parameters``, repeatedly if needed."""
        self.found()
        nodes = self.until(
            lambda: [node for node in self.publishers if node],
            what="the name of the drill's node was not discovered",
        )
        full_name = f"{nodes[0]}/{name}"
        if full_name not in self._clients:
            self._clients[full_name] = self.node.create_client(kind, full_name)
            self._introduce(self._patience)
        return self._call(full_name, request, repeat=True)

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
            self.until(
                lambda: self._is_heard(publisher), what=f"the drill did not subscribe to {topic}"
            )
        return self._publishers[name]

    def _is_heard(self, publisher: Publisher) -> bool:
        """Return whether the drill is among the subscribers, and all are connected."""
        infos = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
        # One that asks for messages from before, which a command never has, is not connected.
        volatile = DurabilityPolicy.VOLATILE
        names = [node_name(info) for info in infos if info.qos_profile.durability == volatile]
        drills = {name for name in self.publishers if name}
        return not drills.isdisjoint(names) and publisher.get_subscription_count() >= len(names)

    def _introduce(self, patience: float) -> None:
        """Wait until the drill has discovered all subscriptions and clients of this node.

        Discovery reports them in the order in which they were made: an answer to the last one
        shows that the drill knows all. Otherwise it could drop a response or the first messages.
        """
        last = self.node.create_client(GetSimulationState, "simulation/get_state")
        try:
            self._listening.call(last, GetSimulationState.Request(), patience, repeat=True)
        finally:
            self.node.destroy_client(last)

    def _check_alone(self) -> None:
        """Check that one drill alone is there; one that was killed counts for nothing."""
        if len(self.publishers) < 2:
            return
        # The middleware remembers a killed drill for 20 s. Only the numbers of living ones go on.
        deadline = time.monotonic() + _STATUS_PERIOD
        while time.monotonic() < deadline and len(names := self.publishers) > 1:
            if any(after <= before for before, after in pairwise(self._sequence)):
                known = ", ".join(filter(None, names))
                raise NoDrillError(
                    f"{len(names)} nodes publish {self.node.resolve_topic_name('status')} "
                    f"({known}): all of them would answer; start each drill in a namespace of its "
                    "own"
                )
            self._listening.spin(0.02)

    def _on_status(self, status: Status, info: dict[str, Any]) -> None:
        self._latest = status
        self._statuses += 1
        if info.get("publication_sequence_number") is not None:
            self._sequence.append(info["publication_sequence_number"])
        self._observer("status", status)

    def _on_faults(self, faults: Faults) -> None:
        self._latest_faults = faults
        self._observer("faults", faults)

    def _on_results(self, results: CommandResults) -> None:
        for result in results.results:
            if result.header.frame_id == self._awaited != "":
                self._result, self._shown = result, results.status
        self._observer("command_results", results)
