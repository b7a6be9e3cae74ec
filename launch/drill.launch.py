"""Start the drill: `ros2 launch rpud_sim drill.launch.py weight_on_bit:=20`.

`record:=DIR` records its topics as well.
"""

from difflib import get_close_matches
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.logging import get_logger
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.ros.launching import end_with
from rpud_sim.simulation.configuration import PARAMETERS

DEFAULT = "drilling.yaml"


def parameter_files(context: LaunchContext) -> list[Path]:
    """Return the files of `config` and `params_file`, or the default drill.

    The error of a missing one ends the launch: launch itself would start the drill without it.
    """
    share = Path(get_package_share_directory("rpud_sim"), "config")
    folders = {"config": (Path(), share), "params_file": (Path(),)}
    files = []
    for name, places in folders.items():
        given = LaunchConfiguration(name).perform(context)
        found = [folder / given for folder in places if (folder / given).is_file()]
        if given and not found:
            where = f"neither here nor in {share}" if name == "config" else "here"
            raise FileNotFoundError(f"{name}: there is no file {given}, {where}")
        files += found[:1]
    return files or [share / DEFAULT]


def warn_of_others(context: LaunchContext) -> None:
    """Warn of arguments that look like a parameter: launch ignores what nobody declares.

    It is no error, for a launch file that includes this one may have arguments of its own.
    """
    own = ("namespace", "config", "params_file", "log_level", "use_sim_time", "record")
    names = [*PARAMETERS, *own]
    for name, value in context.launch_configurations.items():
        close = get_close_matches(name, names, 1, 0.85)
        if close and name not in names:
            text = f"{name}:={value} is no argument of the drill; did you mean {close[0]}?"
            get_logger("drill.launch.py").warning(text)


def start_drill(context: LaunchContext) -> list[Node]:
    """Return the drill node; its parameter files are found first."""
    warn_of_others(context)
    files = parameter_files(context)
    given = {name: LaunchConfiguration(name).perform(context) for name in PARAMETERS}
    given["use_sim_time"] = LaunchConfiguration("use_sim_time").perform(context)
    parameters = [f"{name}:={value}" for name, value in given.items() if value]
    return [
        Node(
            package="rpud_sim",
            executable="drill_node",
            namespace=LaunchConfiguration("namespace"),
            arguments=["--with-parent"],  # or it would go on when launch is killed
            ros_arguments=[
                *(word for path in files for word in ("--params-file", str(path))),
                *(word for each in parameters for word in ("-p", each)),
                *("--log-level", LaunchConfiguration("log_level")),
            ],
            output="screen",
            on_exit=end_with("drill"),
        )
    ]


def start_recorder(context: LaunchContext) -> list[Node]:
    """Return the recorder of the drill's namespace, with the time that the drill has."""
    folder = LaunchConfiguration("record").perform(context)
    params_file = LaunchConfiguration("params_file").perform(context)
    sim_time = LaunchConfiguration("use_sim_time").perform(context)
    if not folder:
        return []
    return [
        Node(
            package="rpud_sim",
            executable="recorder",
            namespace=LaunchConfiguration("namespace"),
            arguments=["--with-parent", "--out", folder],
            ros_arguments=[
                *(["--params-file", params_file] if params_file else []),
                *(["-p", f"use_sim_time:={sim_time}"] if sim_time else []),
                *("--log-level", LaunchConfiguration("log_level")),
            ],
            output="screen",
            on_exit=end_with("recorder"),
        )
    ]


def parameter_arguments() -> list[DeclareLaunchArgument]:
    """Declare each parameter of the drill; without a value, that of the parameter file counts."""
    found = []
    for name, declaration in PARAMETERS.items():
        allowed = declaration.allowed
        unit = f" [{allowed.unit}]" if isinstance(allowed, Quantity) and allowed.unit else ""
        text = f"{allowed.description}{unit}"
        found.append(DeclareLaunchArgument(name, default_value="", description=text))
    return found


def generate_launch_description() -> LaunchDescription:
    """Describe the drill node and, where it is wanted, the recorder of its namespace."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace",
                default_value="rpud",
                description="Namespace of the nodes and of their topics",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value="",
                description="ROS parameter file, which may be that of a whole robot",
            ),
            DeclareLaunchArgument(
                "config",
                default_value="",
                description="Parameter file in the config folder of the package, or a path; "
                f"{DEFAULT} without both files. params_file goes before it, a value by name before "
                "both",
            ),
            DeclareLaunchArgument(
                "log_level",
                default_value="info",
                choices=["debug", "info", "warn", "error", "fatal"],
                description="Least severe messages that the nodes log",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="",
                choices=["", "true", "false"],
                description="Whether the nodes take the time from /clock",
            ),
            DeclareLaunchArgument(
                "record",
                default_value="",
                description="Folder of a new bag, into which the drill is recorded",
            ),
            *parameter_arguments(),
            OpaqueFunction(function=start_drill),
            OpaqueFunction(function=start_recorder),
        ]
    )
