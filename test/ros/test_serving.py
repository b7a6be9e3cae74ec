"""What arrives over the network and raises an error is reported, and the work goes on."""

import sys

import pytest
import rclpy
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import until

from rpud_sim.ros.threads import quick_switches, serve


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
def test_a_message_for_which_rclpy_raises_an_error_is_reported_in_one_line(kind):
    rclpy.init()
    node = rclpy.create_node(
        "follower", parameter_overrides=[Parameter("use_sim_time", value=True)]
    )
    source = rclpy.create_node("source")
    publisher = source.create_publisher(Clock, "/clock", 10)
    executor = kind()
    executor.add_node(node)
    failures = []

    def send(seconds):
        message = Clock()
        message.clock.sec = seconds
        publisher.publish(message)
        serve(executor, failures.append)

    try:
        until(lambda: send(-1) or failures)
        assert failures[0].startswith("it raised ValueError: ")
        assert "\n" not in failures[0]
        until(lambda: send(7) or node.get_clock().now().nanoseconds == 7_000_000_000)
    finally:
        executor.shutdown()
        source.destroy_node()
        node.destroy_node()
        rclpy.try_shutdown()


def test_switches_are_quick_inside_the_context_alone():
    before = sys.getswitchinterval()
    with quick_switches():
        assert sys.getswitchinterval() < 1e-3 < before
    assert sys.getswitchinterval() == before
