"""Start the drill: `ros2 launch rpud_sim drill.launch.py`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def parameter_file(given: str) -> Path:
    """Return the file of `config`: a path, or a name in the package's `config` folder.

    The error of a missing one ends the launch: launch itself would start the drill without it.
    """
    folder = Path(get_package_share_directory("rpud_sim"), "config")
    for path in (Path(given), folder / given):
        if path.is_file():
            return path
    raise FileNotFoundError(f"config: there is no file {given}, neither here nor in {folder}")


def end_with_drill(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
    """End the launch with its drill; only an exception gives a launch a nonzero exit code."""
    if event.returncode != 0:
        raise RuntimeError(f"the drill failed with exit code {event.returncode}")
    return [Shutdown(reason="the drill has ended")]


def start_drill(context: LaunchContext) -> list[Node]:
    """Return the drill node; its parameter file is found first."""
    config = parameter_file(LaunchConfiguration("config").perform(context))
    return [
        Node(
            package="rpud_sim",
            executable="drill_node",
            namespace=LaunchConfiguration("namespace"),
            parameters=[{"use_sim_time": LaunchConfiguration("use_sim_time")}],
            arguments=["--with-parent"],  # or it would go on when launch is killed
            ros_arguments=[
                *("--params-file", str(config)),
                *("--log-level", LaunchConfiguration("log_level")),
            ],
            output="screen",
            on_exit=end_with_drill,
        )
    ]


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
                description="Parameter file of the drill, a path or a name in the package",
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
            OpaqueFunction(function=start_drill),
        ]
    )
