"""Jams the free mass for a second once the drill hammers, and prints the ground truth."""

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rpud_msgs.msg import Fault, Faults, Status
from rpud_msgs.srv import InjectFault

statuses, truths = [], []
rclpy.init()
node = rclpy.create_node("inject_a_fault", namespace="/rpud")
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(Status, "status", statuses.append, latched)
node.create_subscription(Faults, "faults", truths.append, latched)
client = node.create_client(InjectFault, "inject_fault")

while not (statuses and statuses[-1].impacts and client.service_is_ready()):
    rclpy.spin_once(node, timeout_sec=0.1)
request = InjectFault.Request(fault=Fault(kind=Fault.KIND_FREE_MASS_JAMMED))
request.duration = Duration(sec=1)
future = client.call_async(request)
rclpy.spin_until_future_complete(node, future)
if not future.result().success:
    raise SystemExit(f"rejected: {future.result().message}")
number = future.result().number


def of_ours():
    """Return the latest word on the fault, or nothing before the first one."""
    return next((each for each in truths[-1].faults if each.number == number), None)


while not truths or of_ours() is None or of_ours().active:
    rclpy.spin_once(node)
fault = of_ours()
seconds = fault.clear.sec - fault.onset.sec + (fault.clear.nanosec - fault.onset.nanosec) / 1e9
print(f"fault {fault.number}, {fault.kind}, lasted {seconds:.3f} s of simulation time")

node.destroy_node()
rclpy.shutdown()
