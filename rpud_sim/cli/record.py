"""`rpud record`: record ROS topics into a bag."""

from __future__ import annotations

import argparse

from rpud_sim.ros.arguments import add_record_arguments

HELP = "record ROS topics into a bag that rosbag2 reads"
EXAMPLE = "rpud record --out bags/first --duration 10"

add_arguments = add_record_arguments


def run(arguments: argparse.Namespace) -> int:
    """Record until the duration is over or a signal asks to stop; give the exit code."""
    from rpud_sim.ros.record import recorder

    return recorder.run(arguments)
