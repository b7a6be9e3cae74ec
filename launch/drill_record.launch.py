"""Start the drill and record its topics: `ros2 launch rpud_sim drill_record.launch.py`."""

from datetime import datetime

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    Shutdown,
)
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def end_with_recorder(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
    """End the drill, which would go on unrecorded; a failure of the recorder is one of the launch.

    Only an exception gives a launch a nonzero exit code.
    """
    if event.returncode != 0:
        raise RuntimeError(f"the recorder failed with exit code {event.returncode}")
    return [Shutdown(reason="the recorder has ended")]


def start_recorder(context: LaunchContext) -> list[Node]:
    """Return the recorder, with the time that the drill has."""
    params_file = LaunchConfiguration("params_file").perform(context)
    sim_time = LaunchConfiguration("use_sim_time").perform(context)
    return [
        Node(
            package="rpud_sim",
            executable="recorder",
            namespace=LaunchConfiguration("namespace"),
            arguments=[
                "--with-parent",
                *("--out", LaunchConfiguration("bag")),
                *("--compression", LaunchConfiguration("compression")),
                *("--max-loss", LaunchConfiguration("max_loss")),
            ],
            ros_arguments=[
                *(["--params-file", params_file] if params_file else []),
                *(["-p", f"use_sim_time:={sim_time}"] if sim_time else []),
                *("--log-level", LaunchConfiguration("log_level")),
            ],
            output="screen",
            on_exit=end_with_recorder,
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the drill node and, beside it, the recorder of its namespace."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "bag",
                default_value=f"rpud_{datetime.now():%Y_%m_%d-%H_%M_%S}",
                description="Folder of the new bag",
            ),
            DeclareLaunchArgument(
                "compression",
                default_value="zstd",
                choices=["none", "zstd"],
                description="Compression of the bag",
            ),
            DeclareLaunchArgument(
                "max_loss",
                default_value="1.0",
                description="Seconds of messages that a crash may cost at most",
            ),
            # Declares namespace, files, parameters, log_level and use_sim_time for what follows.
            IncludeLaunchDescription(
                PathJoinSubstitution([FindPackageShare("rpud_sim"), "launch", "drill.launch.py"])
            ),
            OpaqueFunction(function=start_recorder),
        ]
    )
