"""Nodes of tests in this process."""

import pytest
import rclpy


@pytest.fixture
def nodes():
    """Nodes that leave the graph at the end of the test."""
    rclpy.init()
    made = []
    yield made
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def drill_node(nodes):
    """A plain node in the place of a drill's."""
    nodes.append(rclpy.create_node("drill_node", namespace="/rpud"))
    return nodes[-1]
