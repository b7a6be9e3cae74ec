"""Duplicate nodes: other nodes of the drill's name, which would answer the same requests."""

from __future__ import annotations

import errno
import hashlib
import socket
import weakref

from rclpy.node import Node


class NameHold:
    """Hold of a node's name on this machine, which ends with the process at the latest.

    Discovery takes seconds on a busy machine; this knows at once. It is an abstract Unix socket,
    which receives nothing and leaves no file.
    """

    def __init__(self, name: str, domain: int) -> None:
        # Whether a living process of this machine holds the name, in the same domain.
        self.taken = False
        digest = hashlib.sha256(f"{domain} {name}".encode()).hexdigest()  # names may be too long
        held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.release = weakref.finalize(self, held.close)
        try:
            held.bind(f"\0rpud_sim/{digest}")
        except OSError as error:  # a sandbox may forbid it
            self.taken = error.errno == errno.EADDRINUSE
            self.release()


class DuplicateNodes:
    """Count of the other nodes of a node's name, which it holds; it warns if there are some."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._name = (node.get_name(), node.get_namespace())
        self._count = 0
        self._hold = NameHold(node.get_fully_qualified_name(), node.context.get_domain_id())
        self.close = self._hold.release

    def count(self) -> int:
        """Return how many other nodes have the name; one that was killed counts for 20 s more."""
        before = self._count
        names = self._node.get_node_names_and_namespaces()
        self._count = max(0, names.count(self._name) - 1)
        if self._count > before:
            self._node.get_logger().warning(
                f"{self._count + 1} nodes are named {self._node.get_fully_qualified_name()}: all "
                "of them answer the same requests; start each in a namespace of its own"
            )
        return self._count
