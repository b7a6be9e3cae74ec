"""Start the drill: `ros2 launch rpud_sim drill.launch.py`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Describe the drill node alone."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace",
                default_value="rpud",
                description="Namespace of the nodes and of their topics",
            ),
            DeclareLaunchArgument(
                "config",
                default_value=PathJoinSubstitution(
                    [FindPackageShare("rpud_sim"), "config", "drilling.yaml"]
                ),
                description="Parameter file of the drill",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="Least severe messages that the nodes log",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                choices=["true", "false"],
                description="Whether the nodes take the time from /clock",
            ),
            Node(
                package="rpud_sim",
                executable="drill_node",
                namespace=LaunchConfiguration("namespace"),
                parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
                # Not among the parameters: launch would start the drill without a file that is
                # missing, where the drill itself ends with an error.
                ros_arguments=[
                    *("--params-file", LaunchConfiguration("config")),
                    *("--log-level", LaunchConfiguration("log_level")),
                ],
                output="screen",
            ),
        ]
    )
