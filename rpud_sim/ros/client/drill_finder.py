"""Drills of a domain."""

from __future__ import annotations

from rclpy.node import Node

from rpud_sim.foundation.quantities import suggestion
from rpud_sim.ros.client.listening_node import ListeningNode
from rpud_sim.ros.graph import node_name

_STEP = "/simulation/step"
_STEP_TYPE = "rpud_msgs/srv/StepSimulation"


class DrillFinder(ListeningNode):
    """Node that knows the drills of a domain; it never waits. Use it from one thread."""

    def __init__(self, domain_id: int | None = None) -> None:
        super().__init__("rpud_watch_list", "/", domain_id)

    def drills(self) -> list[str]:
        """Return the namespaces of the drills."""
        self.take()
        return drill_namespaces(self.node)


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
