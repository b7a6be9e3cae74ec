"""A node under test that answers each period with a command.

With the argument ``calls`` it engages the drill first, with ``mute`` nothing asks its parameters.
"""

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rpud_msgs.msg import ReactingForce, WeightOnBit
from std_srvs.srv import SetBool


class Commander(Node):
    """Commands 20 N at each multiple of 0.1 s."""

    def __init__(self):
        services = "mute" not in sys.argv
        super().__init__("commander", namespace="/rpud", start_parameter_services=services)
        self.weights = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self.create_subscription(ReactingForce, "reacting_force", self.hear, 1000)
        self.engage = self.create_client(SetBool, "engage") if "calls" in sys.argv else None

    def hear(self, message):
        if message.header.stamp.nanosec % 100_000_000:
            return
        command = WeightOnBit(header=message.header, force=20.0)
        if self.engage is None:
            self.weights.publish(command)
            return
        future = self.engage.call_async(SetBool.Request(data=True))
        future.add_done_callback(lambda _: self.weights.publish(command))
        self.engage = None


try:
    rclpy.init()
    rclpy.spin(Commander())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
