"""Client of one running drill."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, TypeVar

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rpud_msgs.srv import GetDelivery

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.client.commands import Commands
from rpud_sim.ros.client.drill_connection import DrillConnection
from rpud_sim.ros.client.drill_watch import stamp_of
from rpud_sim.ros.client.fault_services import FaultServices
from rpud_sim.ros.client.simulation_services import SimulationServices
from rpud_sim.ros.client.telemetry import Telemetry

PATIENCE = 10.0  # time limit of a client, unless it is given another one [s]

Value = TypeVar("Value")


class DrillClient(Commands, FaultServices, SimulationServices):
    """Commands and hears one running drill.

    A command returns when the drill has accepted it, so that a step which follows cannot overtake
    it. It raises a ``RefusedError`` with the drill's own reason if the drill refuses it::

        with DrillClient() as drill:
            drill.pause()
            drill.press(30.0)
            drill.step(0.5)
            print(drill.status.impacts)

    The client has one node in a context of its own, and no thread: it takes messages while one of
    its methods waits. Use it from one thread. A drill that does not answer raises a
    ``NoAnswerError`` after the patience, a missing one a ``NoDrillError``. ``patience`` is in s.
    """

    def __init__(
        self,
        namespace: str = "/rpud",
        domain_id: int | None = None,
        node_name: str = "drill_client",
        patience: float = PATIENCE,
    ) -> None:
        super().__init__(DrillConnection(namespace, domain_id, node_name, patience))

    def __enter__(self) -> DrillClient:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph."""
        self._drill.listening.close()

    @property
    def node(self) -> Node:
        """Node of the client, for publishers and services of your own."""
        return self._drill.node

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return self._drill.namespace

    @property
    def time(self) -> float:
        """Stamp of the latest status [s]."""
        return stamp_of(self.status) / SECOND

    def check_while_waiting(self, check: Callable[[], object]) -> None:
        """Call this while a method waits; an error that it raises ends the wait.

        A test that has started the drill knows at once that the drill has died.
        """
        self._drill.listening.check = check

    @property
    def status_number(self) -> int:
        """Number that the drill's publisher has given to the latest status; 0 before the first."""
        return self._drill.watch.number

    def delivery(self, nodes: Sequence[str] = ()) -> GetDelivery.Response:
        """Return what the drill has published, and who has discovered it.

        It asks these nodes, by full names, whether they know the drill: ask again until all have
        answered.
        """
        request = GetDelivery.Request(nodes=nodes)
        return self._drill.call("simulation/get_delivery", request, repeat=True)

    def found(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status.

        Every other method does this first. ``patience`` is in s; None for that of the client. A
        drill that has never run on a machine may compile for a minute.
        """
        self._drill.find(patience)

    def listen(
        self,
        topic: str,
        kind: Any = None,
        qos: QoSProfile | None = None,
        patience: float | None = None,
    ) -> list[Any]:
        """Subscribe to a topic, and return the list that its messages are added to.

        Args:
            topic: of any node; a relative name is one of the drill's namespace.
            kind: class of its messages; None for that with which it is published.
            qos: of the subscription; None for what its publishers offer.
            patience: time limit for the topic [s]; None for that of the client.
        """
        return self._drill.listen(topic, kind, qos, patience)

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
        return self._drill.until(condition, what, patience)

    def observe(self, observer: Callable[[str, Any], object]) -> None:
        """Call a function with the name and each message of some topics.

        These are ``status``, ``faults``, ``journal`` and ``command_results``. They are latched:
        what came before is not repeated. Observe before the client has waited.
        """
        self._drill.watch.observer = observer

    def telemetry(self, sinks: Mapping[str, Callable[[int, tuple[Any, ...]], object]]) -> Telemetry:
        """Subscribe to fast topics, whose messages are decoded in a few microseconds.

        ``sinks`` has, by topic, a function of the stamp [ns] and the values, as ``Telemetry`` has
        them.
        """
        return Telemetry(self._drill.listening, sinks)

    def take(self) -> None:
        """Take all messages that have arrived, without a wait; responses and events stay."""
        self._drill.listening.settle()

    def spin(self, seconds: float = 0.0) -> None:
        """Take messages, responses and events that have arrived, or wait for the next one [s]."""
        self._drill.listening.spin(seconds)

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the drill's status; no node, no drill."""
        return self._drill.watch.publishers
