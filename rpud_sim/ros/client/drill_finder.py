"""Drills of a domain: which there are, and what each says of itself."""

from __future__ import annotations

import time
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rpud_msgs.msg import Status

from rpud_sim.foundation.quantities import suggestion
from rpud_sim.ros.client.listening_node import ListeningNode
from rpud_sim.ros.graph import node_name

_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_STEP = "/simulation/step"
_STEP_TYPE = "rpud_msgs/srv/StepSimulation"
_SILENCE = 4.0  # of a drill that is gone; the middleware remembers a killed one for 20 s [s]


class DrillFinder(ListeningNode):
    """Node that knows the drills of a domain; it never waits. Use it from one thread."""

    def __init__(self, domain_id: int | None = None, node_name: str = "rpud_watch_list") -> None:
        super().__init__(node_name, "/", domain_id)
        self._statuses: dict[str, Subscription] = {}  # by namespace
        self._heard: dict[str, tuple[float, Status]] = {}

    def drills(self) -> list[dict[str, Any]]:
        """Return each drill with its namespace and what its status says.

        The state is ``silent`` if it publishes none any more, and empty before the first.
        """
        namespaces = drill_namespaces(self.node)
        for gone in self._statuses.keys() - set(namespaces):
            self.unsubscribe(self._statuses.pop(gone))
            self._heard.pop(gone, None)
        for namespace in namespaces:
            if namespace not in self._statuses:
                self._statuses[namespace] = self._listen(namespace)
        self.settle()
        return [self._drill(namespace) for namespace in namespaces]

    def _listen(self, namespace: str) -> Subscription:
        def heard(status: Status) -> None:
            self._heard[namespace] = time.monotonic(), status

        return self.subscribe(Status, f"{namespace.rstrip('/')}/status", heard, _LATCHED)

    def _drill(self, namespace: str) -> dict[str, Any]:
        now, known = time.monotonic(), namespace in self._heard
        heard_at, status = self._heard.get(namespace, (now, Status()))
        return {
            "namespace": namespace,
            "state": "silent" if now - heard_at > _SILENCE else str(status.state),
            "regime": str(status.regime),
            "weight_on_bit": float(status.weight_on_bit) if known else None,
            "active_faults": int(status.active_faults),
            "impacts": int(status.impacts),
        }


def drill_namespaces(node: Node) -> list[str]:
    """Return the namespaces in which there are drills, as far as the node has discovered them."""
    return sorted(
        name.removesuffix(_STEP) or "/"
        for name, types in node.get_service_names_and_types()
        if name.endswith(_STEP) and _STEP_TYPE in types
    )


def drill_nodes(node: Node) -> list[str]:
    """Return the names of the nodes that publish a drill's status in the namespace of a node.

    A name is empty where it is not discovered yet.
    """
    infos = node.get_publishers_info_by_topic(node.resolve_topic_name("status"))
    return [node_name(info) for info in infos if info.topic_type == "rpud_msgs/msg/Status"]


def no_drill(node: Node, namespace: str, domain_id: int, patience: float) -> str:
    """Return one line that says that there is no drill in a namespace, and where there are some."""
    others = [each for each in drill_namespaces(node) if each != namespace]
    where = "there is none in the whole domain: `rpud run` starts one"
    if others:
        where = f"there is one in {', '.join(others)}{suggestion(namespace, others)}"
    return f"no drill in {namespace} of ROS domain {domain_id} within {patience:g} s; {where}"
