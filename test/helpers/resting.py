"""Node under test whose process rests between tests: ``python resting.py HOW``.

It takes long for each impact, so that many wait when a test ends. Each answer has the sequence of
the first impact that it has received. HOW is what it does when it is called to leave.
"""

import sys
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from rpud_msgs.msg import ContactForce, ReactingForce, WeightOnBit
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Resting(Node):
    """Answers ten times a second of simulation time."""

    def __init__(self, how):
        super().__init__("resting", namespace="/rpud")
        self.how = how
        self.over = Future()
        self.first = ""
        self.unanswered = []  # headers
        self.weight = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self.answers = self.create_publisher(Header, "resting/answer", 10)
        self.state = self.create_publisher(String, "resting/state", LATCHED)
        self.create_subscription(ContactForce, "contact_force", self.on_impact, 2000)
        self.create_subscription(ReactingForce, "reacting_force", self.on_force, 1000)
        self.create_service(Trigger, "resting/leave", self.on_leave)
        self.state.publish(String(data="begun"))
        print("it is there", flush=True)

    def on_impact(self, message):
        self.first = self.first or str(message.sequence)
        self.answer()
        time.sleep(0.002)

    def on_force(self, message):
        if message.header.stamp.nanosec % 100_000_000 == 0:
            self.unanswered.append(message.header)
            self.answer()

    def answer(self):
        """Answer once it has an impact: messages of the other topic may arrive first."""
        while self.first and self.unanswered:
            header = self.unanswered.pop(0)
            self.weight.publish(WeightOnBit(header=header, force=9.0))
            self.answers.publish(Header(stamp=header.stamp, frame_id=self.first))

    def on_leave(self, request, response):
        if self.how != "stays":
            self.over.set_result(None)
        return response


def main(how):
    rclpy.init()
    while True:
        node = Resting(how)
        rclpy.spin_until_future_complete(node, node.over)
        node.destroy_node()
        if how == "ends":
            return
        input()


if __name__ == "__main__":
    main(sys.argv[1])
