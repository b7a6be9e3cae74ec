"""A program whose children listen to the telemetry of /rpud, and die by SIGKILL as they listen.

It prints `killed` and their number at its end. Its arguments are how many listeners die, and how
many listen at a time.
"""

import os
import random
import signal
import sys

import rclpy
from rclpy.qos import QoSProfile
from rpud_msgs.msg import ContactForce, DrillTool, NodalPlane, ReactingForce

KINDS = {
    "contact_force": ContactForce,
    "drill_tool": DrillTool,
    "nodal_plane": NodalPlane,
    "reacting_force": ReactingForce,
}


def listen():
    """Listen until a random one of the next messages, and die while others arrive."""
    left = random.Random(os.getpid()).randrange(1, 1000)

    def hear(_):
        nonlocal left
        left -= 1
        if not left:
            os.kill(os.getpid(), signal.SIGKILL)

    rclpy.init()
    node = rclpy.create_node("listener", namespace="/rpud", enable_rosout=False)
    for topic, kind in KINDS.items():
        node.create_subscription(kind, topic, hear, QoSProfile(depth=5000), raw=True)
    rclpy.spin(node)


def start():
    """Start a listener."""
    if os.fork() == 0:
        try:
            listen()
        finally:
            os._exit(1)


count, together = map(int, sys.argv[1:])
for _ in range(together):
    start()
killed = 0
for number in range(count):
    _, status = os.wait()
    killed += os.WIFSIGNALED(status)
    if number + together < count:
        start()
print(f"killed {killed}", flush=True)
