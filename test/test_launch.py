"""The launch files: what they declare, and that what they start exists and takes their flags."""

import ast
import contextlib
import importlib.util
import os
import re
import signal
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
)

from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.testing import launcher

pytestmark = pytest.mark.extended

ROOT = Path(__file__).resolve().parent.parent
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))

every_launch_file = pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)


def calls(path: Path, name: str) -> list[ast.Call]:
    """Return every call of a function in a launch file."""
    return [
        node
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and getattr(node.func, "id", None) == name
    ]


def name_of(call: ast.Call) -> str | None:
    """Return the literal name of an argument; None if the file computes it."""
    return call.args[0].value if isinstance(call.args[0], ast.Constant) else None


def keyword(call: ast.Call, name: str) -> str | None:
    """Return the literal that a call gives to a keyword."""
    return next((ast.literal_eval(k.value) for k in call.keywords if k.arg == name), None)


def strings(path: Path) -> set[str]:
    """Return every string in a launch file, docstrings with them."""
    tree = ast.walk(ast.parse(path.read_text()))
    return {n.value for n in tree if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def declared(path: Path) -> set[str]:
    """Return the arguments that a launch file declares, itself or by including another."""
    own = {name_of(call) for call in calls(path, "DeclareLaunchArgument")}
    if None in own:  # in a loop over the parameters
        own = {*own, *PARAMETERS} - {None}
    included = [each for each in LAUNCH_FILES if each != path and each.name in strings(path)]
    return own.union(*map(declared, included))


@every_launch_file
def test_what_is_used_is_declared_and_described(path):
    for call in calls(path, "DeclareLaunchArgument"):
        assert any(word.arg == "description" for word in call.keywords), name_of(call)
    used = {name_of(call) for call in calls(path, "LaunchConfiguration")} - {None}
    assert used <= declared(path)
    assert {"namespace", "log_level"} <= used


@every_launch_file
def test_nodes_are_executables_of_the_package_or_of_one_that_it_names(path):
    folder = Path(get_package_prefix("rpud_sim"), "lib", "rpud_sim")
    manifest = (ROOT / "package.xml").read_text()
    nodes = calls(path, "Node")
    assert nodes
    for node in nodes:
        package = keyword(node, "package")
        # Without it the launch goes on, and ends with 0, when the node has failed.
        assert package == "rviz2" or any(word.arg == "on_exit" for word in node.keywords)
        if package == "rpud_sim":
            assert os.access(folder / keyword(node, "executable"), os.X_OK)
        else:
            assert re.search(rf"\b{package}\b", manifest), package


@every_launch_file
def test_launch_description_can_be_built(path):
    pytest.importorskip("launch_ros", reason="launch comes with an installed ROS only")
    spec = importlib.util.spec_from_file_location("launch_file", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    description = module.generate_launch_description()
    arguments = {argument.name for argument in description.get_launch_arguments()}
    assert declared(path) <= arguments
    assert "params_file" not in arguments or arguments >= set(PARAMETERS)


@pytest.fixture
def launch(process):
    """Launch a file for real, with arguments."""
    pytest.importorskip("launch_ros", reason="launch comes with an installed ROS only")

    def start(name, *arguments):
        return process(sys.executable, "-m", launcher.__name__, ROOT / "launch" / name, *arguments)

    return start


def left_behind(launched):
    """Give the command lines of what still runs in the group of a launch that has ended."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(ProcessLookupError, FileNotFoundError):
            words = (folder / "cmdline").read_text().replace("\0", " ")
            if words and os.getpgid(int(folder.name)) == launched.pid:  # a zombie has no words
                found.append(words)
    return found


def test_display_starts_nothing_where_a_package_is_missing(launch):
    try:
        get_package_prefix("robot_state_publisher")
    except PackageNotFoundError:
        missing, arguments = "robot_state_publisher", []
    else:
        missing, arguments = "rviz2", ["rviz:=true"]
        with pytest.raises(PackageNotFoundError):
            get_package_prefix(missing)
    launched = launch("display.launch.py", *arguments)
    assert launched.wait() == 1
    assert f"package '{missing}' not found" in launched.output
    assert left_behind(launched) == []


def test_a_drill_has_the_parameters_of_its_file_and_those_that_are_given_by_name(launch, tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(
        "/**: {ros__parameters: {max_speed: 3.0, seed: 5}}\n"
        "/left/drill_node: {ros__parameters: {regime: free, weight_on_bit: 3.0}}\n"
    )
    words = (f"params_file:={path}", "weight_on_bit:=2.5", "frame_prefix:=left_")
    launched = launch("drill.launch.py", "namespace:=left", "wieght_on_bit:=9", *words)
    line = "wieght_on_bit:=9 is no argument of the drill; did you mean weight_on_bit"
    launched.wait_for_line(re.escape(line))
    launched.wait_for_line("left out, not parameters of the drill: max_speed")
    launched.wait_for_line("drilling: regime free, weight on bit 2.5 N")
    launched.interrupt()
    assert launched.wait() == 0


def test_a_launch_whose_drill_fails_fails(launch, tmp_path):
    (tmp_path / "bad.yaml").write_text("/**:\n  ros__parameters: {gravity: -1.0}\n")
    bag = tmp_path / "bag"
    launched = launch("drill.launch.py", f"params_file:={tmp_path}/bad.yaml", f"record:={bag}")
    assert launched.wait() == 1
    assert "gravity = -1 m/s^2 is outside its range" in launched.output
    assert "the drill failed with exit code 2" in launched.output
    assert left_behind(launched) == []


def test_a_launch_whose_replayer_fails_fails(launch):
    launched = launch("replay.launch.py", "bag:=/nonexistent")
    assert launched.wait() == 1
    assert "the replayer failed with exit code 1" in launched.output
    assert left_behind(launched) == []


def test_a_recording_ends_with_its_drill_and_keeps_its_bag(launch, tmp_path):
    launched = launch("drill.launch.py", f"record:={tmp_path / 'bag'}")
    launched.wait_for_line("recording [0-9]+ topics")
    drill = launched.wait_for_line(r"drill_node-\d+\]: process started with pid \[(\d+)\]")
    os.kill(int(drill[1]), signal.SIGKILL)
    assert launched.wait() == 1
    assert "the drill failed with exit code -9" in launched.output
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    assert left_behind(launched) == []


def test_a_recorded_drill_and_its_recorder_end_well_at_an_interrupt(launch, tmp_path):
    launched = launch("drill.launch.py", f"record:={tmp_path / 'bag'}")
    launched.wait_for_line("drilling: regime drilling")
    launched.wait_for_line("recording [0-9]+ topics")
    launched.interrupt()
    assert launched.wait() == 0
    assert (tmp_path / "bag" / "metadata.yaml").exists()
