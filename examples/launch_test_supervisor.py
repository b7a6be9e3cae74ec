"""Launch test of the supervisor: starts it and the drill, and tests what they print and publish.

Run it with ``launch_test examples/launch_test_supervisor.py``.
"""

import sys
import unittest
from pathlib import Path

import launch_testing.actions
import launch_testing.asserts
from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.actions import Node

SUPERVISOR = Path(__file__).parent / "supervisor.py"
COMPILED = 100.0  # seconds in which the very first drill has compiled
DRILL = {
    "regime": "free",  # the supervisor engages
    "drive_enabled": False,  # and drives
    "weight_on_bit": 0.0,
    "command_timeout": 5.0,  # a busy machine may keep the supervisor from commanding for a while
}


def generate_test_description():
    """Describe both; the tests begin immediately and wait for what they test."""
    drill = Node(
        package="rpud_sim",
        executable="drill_node",
        namespace="rpud",
        parameters=[DRILL],
        output="screen",
    )
    supervisor = ExecuteProcess(
        cmd=[sys.executable, str(SUPERVISOR), "--ros-args", "-r", "__ns:=/rpud"],
        output="screen",
    )
    ready = launch_testing.actions.ReadyToTest()
    return LaunchDescription([drill, supervisor, ready]), {"supervisor": supervisor}


class TestMission(unittest.TestCase):
    """While both run."""

    def test_the_supervisor_drills_at_its_target(self, proc_output, supervisor):
        """It puts the drill tool into the rock, ramps the weight on bit, and reaches its target."""
        for line in ("ready: ", "ramping: ", "drilling: reacting force is "):
            proc_output.assertWaitFor(line, process=supervisor, timeout=COMPILED, stream="stderr")


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """After both have been interrupted."""

    def test_both_end_well(self, proc_info):
        """SIGINT does not count as a failure."""
        launch_testing.asserts.assertExitCodes(proc_info)
