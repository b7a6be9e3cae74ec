"""Search for drills in the graph: which there are, and whether one namespace has one alone."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.foundation.quantities import suggestion

_STEP = "/simulation/step"
_UNKNOWN = "_NODE_NAME_UNKNOWN_"  # as rcl calls it
_STEP_TYPE = "rpud_msgs/srv/StepSimulation"


def drill_namespaces(node: Node) -> list[str]:
    """Return the namespaces in which there are drills, as far as the node has discovered them."""
    return sorted(
        name.removesuffix(_STEP) or "/"
        for name, types in node.get_service_names_and_types()
        if name.endswith(_STEP) and _STEP_TYPE in types
    )


def no_drill(node: Node, namespace: str, domain_id: int, patience: float) -> str:
    """Return one line that says that there is no drill in a namespace, and where there are some."""
    text = f"no drill in {namespace} of ROS domain {domain_id} within {patience:g} s; "
    others = [each for each in drill_namespaces(node) if each != namespace]
    if not others:
        return f"{text}there is none in the whole domain: `rpud run` starts one"
    where = "there is one in" if len(others) == 1 else "there are some in"
    return f"{text}{where} {', '.join(others)}{suggestion(namespace, others)}"


def publisher_names(node: Node, topic: str, kind: str) -> list[str]:
    """Return the full names of the nodes that publish a topic, one for each publisher.

    A node whose name has not been discovered yet has an empty one.
    """
    infos = node.get_publishers_info_by_topic(topic)
    return [node_name(endpoint) for endpoint in infos if endpoint.topic_type == kind]


def node_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node; empty where that is not discovered yet."""
    name = endpoint.node_name
    return "" if name == _UNKNOWN else f"{endpoint.node_namespace.rstrip('/')}/{name}"
