"""Service that says what the drill has published, and who has discovered it."""

from __future__ import annotations

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rpud_msgs.srv import GetDelivery

from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.graph import DiscoveryProbe

_MOST_NODES = 100  # that are asked at a time, whoever wants it


class DeliveryServer:
    """Service ``simulation/get_delivery``; to be made after all subscriptions and services.

    Without a request it costs nothing.
    """

    def __init__(self, node: Node, loop: PacingLoop) -> None:
        self._node = node
        self._loop = loop
        self._probes: dict[str, DiscoveryProbe] = {}
        group = MutuallyExclusiveCallbackGroup()
        node.create_service(
            GetDelivery, "simulation/get_delivery", self._answer, callback_group=group
        )

    def _answer(
        self, request: GetDelivery.Request, response: GetDelivery.Response
    ) -> GetDelivery.Response:
        for name in self._probes.keys() - set(request.nodes):
            self._probes.pop(name).close()
        response.unanswered = [name for name in request.nodes if not self._answered(name)]
        response.services = [each.service_name for each in self._node.services]
        response.clients = [self._node.count_clients(name) for name in response.services]
        live = self._loop.live
        if live is not None:
            publishers, heard = live.publishers, live.reporter.publishers_heard()
            response.topics = list(publishers.published)
            response.published = list(publishers.published.values())
            response.subscribers = list(publishers.subscribers().values())
            response.acknowledged = publishers.acknowledged()
            response.command_topics, response.publishers = list(heard), list(heard.values())
        return response

    def _answered(self, name: str) -> bool:
        if name not in self._probes:
            if len(self._probes) >= _MOST_NODES:
                return False
            try:
                self._probes[name] = DiscoveryProbe(self._node, name)
            except (NameValidationException, RuntimeError):  # RCLError: it is too long
                return False
        return self._probes[name].answered()
