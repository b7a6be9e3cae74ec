"""A program that listens to topics of /rpud and, when a signal stops it, prints what it received.

The one line is `heard` and a JSON object: for each topic the messages as hexadecimal text. It
prints `listening` when it is ready, and `heard enough` when each topic had as many messages as
asked for by `--expect TOPIC=COUNT`.
"""

import argparse
import json

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import ContactForce, NodalPlane, Status

from rpud_sim.ros.stopping import StopRequest

TOPICS = {
    "/rpud/contact_force": (ContactForce, QoSProfile(depth=10_000)),
    "/rpud/nodal_plane": (
        NodalPlane,
        QoSProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT),
    ),
    "/rpud/status": (Status, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)),
    "/clock": (Clock, QoSProfile(depth=10_000, reliability=ReliabilityPolicy.BEST_EFFORT)),
}

parser = argparse.ArgumentParser()
parser.add_argument("--expect", nargs="+", default=[], metavar="TOPIC=COUNT")
arguments = parser.parse_args()
expected = {topic: int(count) for topic, count in (word.split("=") for word in arguments.expect)}

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("listener")
heard: dict[str, list[str]] = {topic: [] for topic in expected or TOPICS}
enough = False


def hear(topic: str, data: bytes) -> None:
    global enough
    heard[topic].append(data.hex())
    if not enough and all(len(heard[name]) >= count for name, count in expected.items()):
        enough = True
        print("heard enough", flush=True)


for name in heard:
    message, qos = TOPICS[name]
    node.create_subscription(message, name, lambda data, name=name: hear(name, data), qos, raw=True)
executor = SingleThreadedExecutor()
executor.add_node(node)
with StopRequest() as stop:
    print("listening", flush=True)
    while not stop.requested:
        executor.spin_once(0.1)
print("heard", json.dumps(heard), flush=True)
