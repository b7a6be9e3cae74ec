"""Launch of a launch file as ``ros2 launch`` does it, whose command line may be missing.

python -m rpud_sim.testing.launcher FILE [NAME:=VALUE ...]
"""

from __future__ import annotations

import sys
from importlib import import_module


def main(words: list[str]) -> int:
    """Launch a file and return the exit code; what it started ends with it."""
    launch = import_module("launch")
    actions = import_module("launch.actions")
    sources = import_module("launch.launch_description_sources")
    include = actions.IncludeLaunchDescription(
        sources.AnyLaunchDescriptionSource(words[0]),
        launch_arguments=[tuple(word.split(":=", 1)) for word in words[1:]],
    )
    service = launch.LaunchService(noninteractive=True)  # it interrupts what it started
    service.include_launch_description(launch.LaunchDescription([include]))
    return int(service.run())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
