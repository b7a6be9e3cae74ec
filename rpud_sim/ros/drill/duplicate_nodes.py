"""Duplicate nodes: other nodes of the drill's name, which would answer the same requests."""

from __future__ import annotations

import errno
import hashlib
import socket
import sys
import time
import weakref

import rclpy
from lifecycle_msgs.srv import GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

_DISCOVERY = 0.6  # that the middleware may take to find another node of this machine [s]
_ANSWER = 2.0  # that a node may take to answer; one that was killed never does [s]


class NameHold:
    """Hold of a node's name on this machine, which ends with the process at the latest.

    Discovery takes seconds on a busy machine; this knows at once. It is an abstract Unix socket,
    which receives nothing and leaves no file. Only Linux has them: elsewhere no name is ever taken.
    """

    def __init__(self, name: str, domain: int) -> None:
        # Whether a living process of this machine holds the name, in the same domain.
        self.taken = False
        if sys.platform != "linux":
            self.release = lambda: None
            return
        digest = hashlib.sha256(f"{domain} {name}".encode()).hexdigest()  # names may be too long
        held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.release = weakref.finalize(self, held.close)
        try:
            held.bind(f"\0rpud_sim/{digest}")
        except OSError as error:  # where a sandbox forbids it, discovery has to do
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


class DuplicateSearch:
    """Search for a living drill of a name, before one of that name is made.

    It holds the name from now on, so of two that search at the same time one finds the other.
    """

    def __init__(self, name: str, namespace: str) -> None:
        # The context's global arguments rename nodes; this one must keep its own name.
        self._node = rclpy.create_node(
            f"{name}_search",
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        namespace = self._node.get_namespace()
        self._name = (name, namespace)
        self.name = f"{namespace.rstrip('/')}/{name}"  # full name that is searched for
        self._hold = NameHold(self.name, self._node.context.get_domain_id())
        self.close = self._hold.release
        self._end = time.monotonic() + _DISCOVERY

    def finish(self) -> bool:
        """Return whether one runs on this machine, or is found within 0.6 s and answers."""
        try:
            if self._hold.taken:
                return True
            while self._name not in self._node.get_node_names_and_namespaces():
                if time.monotonic() >= self._end:
                    return False
                time.sleep(0.01)
            return self._answers()
        finally:
            self._node.destroy_node()

    def _answers(self) -> bool:
        client = self._node.create_client(GetState, f"{self._name[0]}/get_state")
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            if not client.wait_for_service(_ANSWER):
                return False
            future = client.call_async(GetState.Request())
            executor.spin_until_future_complete(future, _ANSWER)
            return future.done()
        finally:
            executor.shutdown()
