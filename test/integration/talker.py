"""A program that talks on three topics of /rpud, one for each kind of QoS that a drill offers.

`contact_force` is reliable, `nodal_plane` best effort and `status` latched. It waits until each has
`--subscribers`, prints `talking`, publishes one status and then `--count` of the others at
`--rate`, waits until reliable subscribers have them, prints `published N` and stays until it is
told to stop.
"""

import argparse
import time

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rpud_msgs.msg import ContactForce, NodalPlane, Status

parser = argparse.ArgumentParser()
parser.add_argument("--count", type=int, required=True)
parser.add_argument("--rate", type=float, default=1000.0)
parser.add_argument("--subscribers", type=int, default=1)
arguments = parser.parse_args()

rclpy.init()
node = rclpy.create_node("talker", namespace="/rpud")
reliable = QoSProfile(depth=10_000)
best_effort = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status = node.create_publisher(Status, "status", latched)
contact_force = node.create_publisher(ContactForce, "contact_force", reliable)
nodal_plane = node.create_publisher(NodalPlane, "nodal_plane", best_effort)
publishers = (status, contact_force, nodal_plane)
try:
    while any(each.get_subscription_count() < arguments.subscribers for each in publishers):
        time.sleep(0.01)
    # A match is known here a moment before it is there, where best effort does not wait for it.
    time.sleep(0.2)
    status.publish(Status(state=Status.STATE_RUNNING, weight_on_bit=10.0))
    print("talking", flush=True)
    began = time.monotonic()
    for number in range(arguments.count):
        time.sleep(max(0.0, began + number / arguments.rate - time.monotonic()))
        contact_force.publish(ContactForce(sequence=number, peak_force=number * 0.5))
        nodal_plane.publish(NodalPlane(position=float(number)))
    acknowledged = contact_force.wait_for_all_acked(Duration(seconds=20))
    print(f"published {arguments.count}" if acknowledged else "not acknowledged", flush=True)
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException, RuntimeError):
    pass  # a RuntimeError is rclpy's where the signal comes at an unlucky moment
