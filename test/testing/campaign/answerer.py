"""System under test of the campaigns: it answers each step with a weight on bit, as long as it does.

    python answerer.py well|dies|hangs|late|deaf --ros-args -r __ns:=/rpud
"""

import os
import signal
import sys
import time

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rpud_msgs.msg import ReactingForce, WeightOnBit

PERIOD = 100_000_000  # of the answers [ns]
WRONG = 300_000_000  # when something other than answering begins [ns]


class Answerer(Node):
    def __init__(self, conduct):
        super().__init__("answerer")
        self._conduct = conduct
        self._weights = self.create_publisher(WeightOnBit, "command/weight_on_bit", 10)
        self.create_subscription(ReactingForce, "reacting_force", self._on_force, 1000)

    def _on_force(self, message):
        stamp = message.header.stamp
        now = stamp.sec * 1_000_000_000 + stamp.nanosec
        if now == 0 or now % PERIOD:
            return
        if now >= WRONG and self._conduct == "dies":
            print("out of memory", flush=True)
            os._exit(3)
        if now >= WRONG and self._conduct == "hangs":
            print("waiting for nothing", flush=True)
            time.sleep(1000.0)
        if now >= WRONG and self._conduct == "late":
            stamp.sec, stamp.nanosec = 0, PERIOD  # an answer to an earlier step
        command = WeightOnBit(force=10.0 + now / PERIOD)
        command.header.stamp = stamp
        self._weights.publish(command)


def main():
    rclpy.init()
    if sys.argv[1] == "deaf":  # to everything but SIGKILL
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
    try:
        rclpy.spin(Answerer(sys.argv[1]))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
