"""Runs the launch test of the supervisor where `launch_testing` is installed."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("launch_testing", reason="launch_testing comes with an installed ROS only")
pytest.importorskip("launch_ros", reason="launch_ros comes with an installed ROS only")

FILE = Path(__file__).parent / "launch_test_supervisor.py"


@pytest.mark.timeout(300)
def test_the_launch_test_of_the_supervisor_passes():
    command = [sys.executable, "-m", "launch_testing.launch_test", FILE]
    result = subprocess.run(command, capture_output=True, text=True, timeout=280)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "Ran 1 test" in result.stdout + result.stderr
