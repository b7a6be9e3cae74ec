"""A program of /rpud that claims to be a drill, and answers and sends what no drill does.

Its parameter `scenario` is the path in its first argument, and by its journal it plans no fault.
With `--odd` a parameter has a type that does not exist, and the journal begins with what is no
JSON. It prints `answered` when it was asked for its parameters.
"""

import sys

import rclpy
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rpud_msgs.msg import JournalEntry, Status

from rpud_sim.ros.stopping import StopRequest

path, odd = sys.argv[1], "--odd" in sys.argv
values = [
    ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=path),
    ParameterValue(type=99 if odd else ParameterType.PARAMETER_NOT_SET),
]


def names(request, response):
    response.result.names = ["scenario", "other"]
    return response


def answers(request, response):
    response.values = values
    print("answered", flush=True)
    return response


rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("stranger", namespace="/rpud", start_parameter_services=False)
node.create_service(ListParameters, "~/list_parameters", names)
node.create_service(GetParameters, "~/get_parameters", answers)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
status = node.create_publisher(Status, "status", latched)
journal = node.create_publisher(JournalEntry, "journal", latched)
status.publish(Status())
begin = "no JSON" if odd else '{"faults": []}'
journal.publish(JournalEntry(kind=JournalEntry.KIND_BEGIN, content=begin))
executor = SingleThreadedExecutor()
executor.add_node(node)
with StopRequest() as stop:
    while not stop.requested:
        executor.spin_once(timeout_sec=0.1)
        status.publish(Status())
