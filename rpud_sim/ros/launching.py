"""End of a launch with one of its nodes; for launch files, as only an installed ROS has launch."""

from __future__ import annotations

from collections.abc import Callable

from launch import LaunchContext
from launch.actions import Shutdown
from launch.events.process import ProcessExited


def end_with(name: str) -> Callable[[ProcessExited, LaunchContext], list[Shutdown]]:
    """End the launch with a node; only an exception gives a launch a nonzero exit code."""

    def end(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
        if event.returncode != 0:
            raise RuntimeError(f"the {name} failed with exit code {event.returncode}")
        return [Shutdown(reason=f"the {name} has ended")]

    return end
