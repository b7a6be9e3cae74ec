"""A program that talks on three topics of /rpud, one for each kind of QoS that a drill offers.

`contact_force` is reliable, `nodal_plane` best effort and `status` latched. It prints `waiting`,
waits until each has `--subscribers`, prints `talking`, publishes one status and then `--count` of
the others at `--rate`, waits until reliable subscribers have them, prints `published N` and stays
until a signal stops it.
"""

import argparse
import time

import rclpy
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import ContactForce, NodalPlane, Status

from rpud_sim.ros.process import StopRequest

parser = argparse.ArgumentParser()
parser.add_argument("--count", type=int, required=True)
parser.add_argument("--rate", type=float, default=1000.0)
parser.add_argument("--subscribers", type=int, default=1)
arguments = parser.parse_args()

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("talker", namespace="/rpud")
reliable = QoSProfile(depth=10_000)
best_effort = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status = node.create_publisher(Status, "status", latched)
contact_force = node.create_publisher(ContactForce, "contact_force", reliable)
nodal_plane = node.create_publisher(NodalPlane, "nodal_plane", best_effort)
publishers = (status, contact_force, nodal_plane)
print("waiting", flush=True)
with StopRequest() as stop:
    while any(each.get_subscription_count() < arguments.subscribers for each in publishers):
        if stop.wait(0.01):
            raise SystemExit
    # A match is known here a moment before it is there, where best effort does not wait for it.
    time.sleep(0.2)
    status.publish(Status(state=Status.STATE_RUNNING, weight_on_bit=10.0))
    print("talking", flush=True)
    began = time.monotonic()
    for number in range(arguments.count):
        if stop.wait(began + number / arguments.rate - time.monotonic()):
            raise SystemExit
        contact_force.publish(ContactForce(sequence=number, peak_force=number * 0.5))
        nodal_plane.publish(NodalPlane(position=float(number)))
    acknowledged = contact_force.wait_for_all_acked(Duration(seconds=20))
    print(f"published {arguments.count}" if acknowledged else "not acknowledged", flush=True)
    while not stop.wait(1.0):
        pass
