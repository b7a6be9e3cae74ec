"""The arm of press.py as a ROS node: the source of /clock, in lockstep with a drill that follows.

    python arm_node.py [SECONDS]

In each step it publishes the motion of the mount and then /clock, and waits for the answer of the
drill at this time.
"""

from __future__ import annotations

import sys
import time

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from press import JAM, JOINTS, STEP, Answer, Arm, fly
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from rpud_msgs.msg import Borehole, Fault, MountMotion, ReactingForce
from rpud_msgs.srv import InjectFault
from sensor_msgs.msg import JointState

NANOSECONDS = round(1e9 * STEP)
START = 1000  # steps: time zero means no time in ROS
PATIENCE = 20.0  # with a drill that does not answer [s]
CONNECTING = 0.1  # that the first answer may take, until both have found each other [s]


class ArmNode(Node):
    """Node of the arm: gives time and motion, and takes force and torque."""

    def __init__(self, arm: Arm) -> None:
        super().__init__("arm", namespace="rpud")
        self._arm, self._steps, self._latest = arm, START, dict[str, object]()
        self._ticks = self.create_publisher(Clock, "/clock", 10)
        self._motion = self.create_publisher(MountMotion, "command/mount", 10)
        self._joints = self.create_publisher(JointState, "arm/joint_states", 10)
        self._inject = self.create_client(InjectFault, "inject_fault")
        self._answers = {
            "wrench": WrenchStamped,
            "reacting_force": ReactingForce,
            "borehole": Borehole,
        }
        for topic, kind in self._answers.items():
            self.create_subscription(kind, topic, lambda m, t=topic: self._take(t, m), 1000)

    def _take(self, topic: str, message: object) -> None:
        self._latest[topic] = message

    def _answered(self, stamp: Time) -> bool:
        latest = self._latest.values()
        return len(latest) == len(self._answers) and all(m.header.stamp == stamp for m in latest)

    def exchange(self, place: float, rate: float) -> Answer:
        """Give the drill the motion of its mount, and return its answer a step later."""
        motion = MountMotion(position=place, velocity=rate)
        motion.header.stamp = self._now()
        self._motion.publish(motion)
        joints = JointState(name=JOINTS, position=self._arm.data.qpos, effort=self._arm.torques)
        joints.header.stamp = self._now()
        self._joints.publish(joints)
        if self._steps == START + round(JAM / STEP):
            self._inject.call_async(InjectFault.Request(fault=Fault(kind="free_mass_jammed")))
        self.tick()
        self._await_answer()
        wrench, force, hole = (self._latest[name] for name in self._answers)
        torque = wrench.wrench.torque.z
        at = (self._steps - START) * STEP
        # The force at an instant, not the mean over a step: nothing is predicted from it.
        return Answer(at, -wrench.wrench.force.z, torque, force.impacts, hole.depth, 0.0, 0.0)

    def _await_answer(self) -> None:
        end = time.monotonic() + PATIENCE
        while not self._answered(self._now()):
            rclpy.spin_once(self, timeout_sec=PATIENCE)
            if time.monotonic() > end:
                # Started again, it waits for the next /clock.
                sys.exit(
                    f"the drill has not answered the time {self._steps * STEP:.3f} s for "
                    f"{PATIENCE:g} s: it has ended, or was started again: start this node again"
                )

    def connect(self) -> None:
        """Let time pass until the drill answers."""
        while not self._answered(self._now()):
            self.tick()
            end = self.get_clock().now().nanoseconds + round(1e9 * CONNECTING)
            while not self._answered(self._now()) and self.get_clock().now().nanoseconds < end:
                rclpy.spin_once(self, timeout_sec=CONNECTING)

    def tick(self) -> None:
        self._steps += 1
        self._ticks.publish(Clock(clock=self._now()))

    def _now(self) -> Time:
        seconds, rest = divmod(self._steps * NANOSECONDS, 10**9)
        return Time(sec=seconds, nanosec=rest)


if __name__ == "__main__":
    rclpy.init()
    arm = Arm()
    node = ArmNode(arm)
    node.connect()
    flown = fly(arm, node.exchange, float(sys.argv[1]) if len(sys.argv) > 1 else 20.0)
    print(f"hole {1e3 * flown['depth'][-1]:.2f} mm, {flown['impacts'][-1]:.0f} impacts")
