"""Proof that a node under test knows the subscriptions of the test."""

from __future__ import annotations

import time

from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node

_REPETITION = 0.05  # of a request, whose response the node may drop [s]
_PATIENCE = 5.0  # with a node that does not answer, or has no such service [s]


class DiscoveryProbe:
    """Request to a node that is made after the subscriptions.

    Discovery announces the readers of a process in the order in which they were made. So a node
    whose response has come knows all readers from before: it will not publish past them. A node
    without the services of parameters gets some time instead. The node under test may have no name,
    which is empty then.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._client: Client | None = (
            node.create_client(GetParameters, f"{name}/get_parameters") if name else None
        )
        self._answered = False
        self._begun = time.monotonic()
        self._sent = 0.0

    def done(self) -> bool:
        """Return whether the node has answered; to be called again until it has."""
        now = time.monotonic()
        if self._answered or now - self._begun > _PATIENCE:
            self.close()
            return True
        if self._client is None:
            return False
        if self._has_response():
            self._answered = True
            self.close()
            return True
        # The middleware may not call the service ready while it remembers an ended namesake.
        if now - self._sent > _REPETITION:
            with self._client.handle:
                self._client.handle.send_request(GetParameters.Request())
            self._sent = now
        return False

    def close(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
            self._client = None

    def _has_response(self) -> bool:
        assert self._client is not None
        with self._client.handle:
            header, _ = self._client.handle.take_response(GetParameters.Response)
        return header is not None
