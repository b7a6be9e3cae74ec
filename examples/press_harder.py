"""Commands a weight on bit of 30 N and waits until the drill has applied it: plain rclpy."""

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Status, WeightOnBit

WEIGHT = 30.0  # on bit [N]

statuses = []
rclpy.init()
node = rclpy.create_node("press_harder", namespace="/rpud")
# The drill latches its status: a late subscriber receives the last one.
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(Status, "status", statuses.append, latched)
commands = node.create_publisher(WeightOnBit, "command/weight_on_bit", 10)


def ready():
    """Return whether the drill runs, and it and its recorder will get the command."""
    if not statuses or statuses[-1].state != Status.STATE_RUNNING:
        return False
    listeners = node.get_subscriptions_info_by_topic("command/weight_on_bit")
    names = [listener.node_name for listener in listeners]
    return "drill_node" in names and commands.get_subscription_count() >= len(names)


# ROS drops a message without a subscriber, so the command waits for the running drill.
while not ready():
    rclpy.spin_once(node, timeout_sec=0.1)
commands.publish(WeightOnBit(force=WEIGHT))
while statuses[-1].weight_on_bit != WEIGHT:
    rclpy.spin_once(node)
print(f"weight on bit is {statuses[-1].weight_on_bit} N after {statuses[-1].impacts} impacts")

commands.wait_for_all_acked()  # a recorder may not have the command yet
node.destroy_node()
rclpy.shutdown()
