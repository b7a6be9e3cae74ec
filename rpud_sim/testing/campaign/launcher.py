"""Launch of a launch file as ``ros2 launch`` does it, whose command line may be missing.

python -m rpud_sim.testing.campaign.launcher FILE [NAME:=VALUE ...]
"""

from __future__ import annotations

import sys


def main(words: list[str]) -> int:
    """Launch a file and return the exit code; what it started ends with it."""
    from launch import LaunchDescription, LaunchService
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import AnyLaunchDescriptionSource

    source = AnyLaunchDescriptionSource(words[0])
    arguments = [tuple(word.split(":=", 1)) for word in words[1:]]
    service = LaunchService(noninteractive=True)  # it interrupts what it started
    include = IncludeLaunchDescription(source, launch_arguments=arguments)
    service.include_launch_description(LaunchDescription([include]))
    return int(service.run())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
