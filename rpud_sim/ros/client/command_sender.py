"""Commands of a client to one drill, and their results."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rpud_msgs import msg

from rpud_sim.ros.client.drill_finder import drill_nodes
from rpud_sim.ros.client.listening_node import ListeningNode, RefusedError
from rpud_sim.ros.client.service_caller import ServiceCaller
from rpud_sim.ros.graph import node_name

_COMMAND_DEPTH = 100


class CommandSender:
    """Publishers of commands; it knows its own results by the headers, which the drill returns.

    ``status_number`` gives the number of the latest status.
    """

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

    def hear(self, message: msg.CommandResults) -> None:
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
        """Return a publisher of a command, which the drill hears.

        It is made for the first command: the drill warns of several publishers, and a client that
        only watches must not be one of them.
        """
        topic = f"command/{name}"
        publisher = self._node.create_publisher(kind, topic, _COMMAND_DEPTH)
        self._services.introduce()
        self._listening.wait_until(
            lambda: self._is_heard(publisher), f"the drill did not subscribe to {topic}"
        )
        return publisher

    def _is_heard(self, publisher: Publisher) -> bool:
        """Return whether the drill is among the subscribers, and all are connected."""
        infos = self._node.get_subscriptions_info_by_topic(publisher.topic_name)
        # One that asks for messages from before, which a command never has, is not connected.
        volatile = DurabilityPolicy.VOLATILE
        names = [node_name(info) for info in infos if info.qos_profile.durability == volatile]
        drills = set(filter(None, drill_nodes(self._node)))
        return not drills.isdisjoint(names) and publisher.get_subscription_count() >= len(names)
