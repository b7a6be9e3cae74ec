"""Launch test in lockstep: the drill steps together with a supervisor that launch has started.

Run it with ``launch_test examples/launch_test_lockstep.py``.
"""

import contextlib
import sys
import unittest
from pathlib import Path

import launch_testing.actions
from launch import LaunchDescription
from launch.actions import ExecuteProcess

from rpud_sim.testing import open_drill

SUPERVISOR = Path(__file__).parent / "supervisor.py"
STATES = "supervisor/state"
DRILL = {
    "regime": "free",  # the supervisor engages
    "drive_enabled": False,  # and drives
    "weight_on_bit": 0.0,
    "command_timeout": 0.5,
}
cleanup = contextlib.ExitStack()


def generate_test_description():
    """Start the drill, and describe the supervisor in the drill's ROS domain."""
    drill = cleanup.enter_context(open_drill(**DRILL))
    drill.listen(STATES, "diagnostic_msgs/msg/DiagnosticArray")
    supervisor = ExecuteProcess(
        cmd=[sys.executable, str(SUPERVISOR), "--ros-args", "-r", f"__ns:={drill.namespace}"],
        additional_env=drill.environment,
        output="screen",
    )
    ready = launch_testing.actions.ReadyToTest()
    return LaunchDescription([supervisor, ready]), {"drill": drill, "supervisor": supervisor}


class TestMission(unittest.TestCase):
    """While both run."""

    @classmethod
    def tearDownClass(cls):
        """End the drill."""
        cleanup.close()

    def test_the_supervisor_retreats_from_a_jam(self, drill, proc_output, supervisor):
        """It commands twice in each period, and the drill waits for both."""
        proc_output.assertWaitFor("ready: ", process=supervisor, timeout=30.0, stream="stderr")
        drill.with_answers("command/drive", "command/weight_on_bit")
        drill.step(3.0)
        drill.inject("free_mass_jammed")
        drill.step_until(lambda: self.state(drill) == "retreating", timeout=1.0)
        drill.step()
        assert drill.status.weight_on_bit == 0.0
        assert not drill.status.drive_enabled

    @staticmethod
    def state(drill):
        """Return the latest state of the supervisor."""
        return drill.latest(STATES).status[0].name
