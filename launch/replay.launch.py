"""Publish a recorded bag: `ros2 launch rpud_sim replay.launch.py bag:=FOLDER`."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from rpud_sim.ros.launching import end_with


def start_replayer(context: LaunchContext) -> list[Node]:
    """Return the replayer; a flag is given or left out, which no substitution can express."""
    flags = [
        f"--{name}"
        for name in ("loop", "clock", "start-paused")
        if IfCondition(LaunchConfiguration(name.replace("-", "_"))).evaluate(context)
    ]
    return [
        Node(
            package="rpud_sim",
            executable="replayer",
            namespace=LaunchConfiguration("namespace"),
            arguments=[
                LaunchConfiguration("bag"),
                "--rate",
                LaunchConfiguration("rate"),
                "--start",
                LaunchConfiguration("start"),
                "--with-parent",  # or it would go on when launch is killed
                *flags,
            ],
            ros_arguments=["--log-level", LaunchConfiguration("log_level")],
            output="screen",
            on_exit=end_with("replayer"),
        )
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the replayer of one bag."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="Folder of the bag to publish"),
            DeclareLaunchArgument(
                "rate", default_value="1.0", description="Speed, as a multiple of the recorded one"
            ),
            DeclareLaunchArgument(
                "start", default_value="0.0", description="Seconds of the bag to leave out"
            ),
            DeclareLaunchArgument(
                "loop",
                default_value="false",
                choices=["true", "false"],
                description="Whether to begin again at the end",
            ),
            DeclareLaunchArgument(
                "clock",
                default_value="false",
                choices=["true", "false"],
                description="Whether to publish the recorded time on /clock",
            ),
            DeclareLaunchArgument(
                "start_paused",
                default_value="false",
                choices=["true", "false"],
                description="Whether to wait for the service ~/resume at the beginning",
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="rpud",
                description="Namespace of the replayer; the topics keep their recorded names",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="Least severe messages that the replayer logs",
            ),
            OpaqueFunction(function=start_replayer),
        ]
    )
