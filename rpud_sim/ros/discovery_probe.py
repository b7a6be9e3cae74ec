"""Proof that another node knows the subscriptions and services of this process."""

from __future__ import annotations

import time

from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future

_REPETITION = 0.05  # of a request, whose response the other node may drop [s]


class DiscoveryProbe:
    """Request to a node, by a client that is made after the subscriptions.

    Discovery announces the readers of a process in the order in which they were made. So a node
    whose response has come knows all readers from before: it will not publish past them. ``name``
    is the full name of the other node; the executor of ``node`` takes the responses.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._client: Client | None = node.create_client(GetParameters, f"{name}/get_parameters")
        self._futures: list[Future] = []
        self._sent = 0.0

    def answered(self) -> bool:
        """Return whether the node has answered; to be called again until it has."""
        if self._client is None:
            return True
        if any(future.done() for future in self._futures):
            self.close()
            return True
        # The middleware may not call the service ready while it remembers an ended namesake.
        now = time.monotonic()
        if now - self._sent > _REPETITION:
            self._futures.append(self._client.call_async(GetParameters.Request()))
            self._sent = now
        return False

    def close(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
            self._client = None
