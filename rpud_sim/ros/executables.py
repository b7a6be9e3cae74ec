"""The executables of `ros2 run`. ROS is loaded when they run: where it is missing is one line."""

from __future__ import annotations

from importlib import import_module

from rpud_sim.foundation.terminal import end_with


def drill_node() -> None:
    """Run the drill."""
    end_with("drill_node", lambda: import_module("rpud_sim.ros.drill.drill_node").main())


def recorder() -> None:
    """Run the recorder."""
    end_with("recorder", lambda: import_module("rpud_sim.ros.record.recorder").main())


def replayer() -> None:
    """Run the replayer."""
    end_with("replayer", lambda: import_module("rpud_sim.ros.replay.replayer").main())
