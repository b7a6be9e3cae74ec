"""A program of /rpud that claims to be a drill, and answers and sends what no drill does.

Its parameter has a type that does not exist. It prints `answered` when it was asked for it.
"""

import rclpy
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import Status

from rpud_sim.ros.process import StopRequest


def names(request, response):
    response.result.names = ["other"]
    return response


def answers(request, response):
    response.values = [ParameterValue(type=99)]
    print("answered", flush=True)
    return response


rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("stranger", namespace="/rpud", start_parameter_services=False)
node.create_service(ListParameters, "~/list_parameters", names)
node.create_service(GetParameters, "~/get_parameters", answers)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status = node.create_publisher(Status, "status", latched)
status.publish(Status())
executor = SingleThreadedExecutor()
executor.add_node(node)
with StopRequest() as stop:
    while not stop.requested:
        executor.spin_once(timeout_sec=0.1)
        status.publish(Status())
