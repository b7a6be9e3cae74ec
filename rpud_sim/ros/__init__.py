"""The ROS 2 face: drill, recorder, replayer, and a client of running drills."""

import sys

from rpud_sim.ros.environment import CheckOfRclpy

sys.meta_path.insert(0, CheckOfRclpy)
