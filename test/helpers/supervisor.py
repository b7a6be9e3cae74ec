"""A node under test: answers each period of 0.1 s, and misbehaves as its first argument says."""

import sys
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rpud_msgs.msg import ReactingForce, WeightOnBit
from std_msgs.msg import Header
from std_srvs.srv import SetBool

PERIOD = 100_000_000  # ns
HOW = sys.argv[1]


class Supervisor(Node):
    """Presses until the mean reacting force of a period is 30 N."""

    def __init__(self):
        super().__init__("supervisor")
        self.force, self.weight = [], 10.0
        self.answers = self.create_publisher(Header, "supervisor/heartbeat", 10)
        quality = QoSProfile(depth=10)
        if HOW == "unheard":
            quality.reliability = ReliabilityPolicy.BEST_EFFORT
        self.weights = self.create_publisher(WeightOnBit, "command/weight_on_bit", quality)
        if HOW == "calls":
            self.nowhere = self.create_client(SetBool, "nowhere")
        self.create_subscription(ReactingForce, "reacting_force", self.hear, 1000)

    def hear(self, message):
        if HOW == "calls":  # and waits for ever
            return
        self.force.append(message.force)
        stamp = message.header.stamp
        now = stamp.sec * 1_000_000_000 + stamp.nanosec
        if now % PERIOD:
            return
        if now > 3 * PERIOD and HOW == "dies":
            print("the supervisor dies", flush=True)
            sys.exit(3)
        if now > 3 * PERIOD and HOW == "hangs":
            print("the supervisor hangs", flush=True)
            time.sleep(1000.0)
        self.weight += 0.3 * (30.0 - sum(self.force) / len(self.force))
        self.force.clear()
        self.weights.publish(WeightOnBit(header=message.header, force=max(0.0, self.weight)))
        if now > 3 * PERIOD and HOW == "lags":
            stamp.nanosec -= PERIOD
        self.answers.publish(message.header)


try:
    rclpy.init()
    rclpy.spin(Supervisor())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
