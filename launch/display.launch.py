"""Start the drill and publish its frames: `ros2 launch rpud_sim display.launch.py rviz:=true`.

A drill on an arm also has the joints of its feed and its rotation:
`ros2 launch rpud_sim display.launch.py config:=arm.yaml feed:=true rotation:=true`.
"""

from pathlib import Path

from ament_index_python.packages import get_package_prefix, get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from rpud_sim.ros.launching import end_with
from rpud_sim.ros.process import robot_description


def find_packages(context: LaunchContext) -> None:
    """Raise PackageNotFoundError if a package is missing, while nothing runs yet."""
    get_package_prefix("robot_state_publisher")
    if IfCondition(LaunchConfiguration("rviz")).evaluate(context):
        get_package_prefix("rviz2")


def display(context: LaunchContext) -> list[Node]:
    """Return the publisher of the frames, and RViz: both depend on which joints there are."""
    share = Path(get_package_share_directory("rpud_sim"))
    feed, rotation = (
        IfCondition(LaunchConfiguration(name)).evaluate(context) for name in ("feed", "rotation")
    )
    prefix = LaunchConfiguration("frame_prefix").perform(context)
    urdf = robot_description(share / "urdf", feed, rotation, prefix)
    sim_time = LaunchConfiguration("use_sim_time").perform(context)
    settings = [{"use_sim_time": sim_time == "true"}] if sim_time else []
    log_level = ["--log-level", LaunchConfiguration("log_level")]
    layout = ["--display-config", str(share / "config" / "display.rviz")]
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            namespace=LaunchConfiguration("namespace"),
            parameters=[*settings, {"robot_description": ParameterValue(urdf, value_type=str)}],
            ros_arguments=log_level,
            output="screen",
            on_exit=end_with("robot_state_publisher"),
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            namespace=LaunchConfiguration("namespace"),
            # On a feed the drill moves: seen from itself, the rail would.
            arguments=[*layout, "--fixed-frame", prefix + ("rpud_rail" if feed else "rpud_base")],
            parameters=settings,
            ros_arguments=log_level,
            condition=IfCondition(LaunchConfiguration("rviz")),
            output="screen",
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the drill node, the publisher of its frames, and RViz if asked."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "rviz",
                default_value="false",
                choices=["true", "false"],
                description="Whether to show the drill in RViz",
            ),
            DeclareLaunchArgument(
                "feed",
                default_value="false",
                choices=["true", "false"],
                description="Whether the robot has the joint rpud_feed, for feed_model arm",
            ),
            DeclareLaunchArgument(
                "rotation",
                default_value="false",
                choices=["true", "false"],
                description="Whether the robot has the joint rpud_rotation, for a rotation_model",
            ),
            # A node whose package is missing ends the launch, and the nodes before it may go on.
            OpaqueFunction(function=find_packages),
            # Declares namespace, files, parameters, log_level and use_sim_time for what follows.
            IncludeLaunchDescription(
                PathJoinSubstitution([FindPackageShare("rpud_sim"), "launch", "drill.launch.py"])
            ),
            OpaqueFunction(function=display),
        ]
    )
