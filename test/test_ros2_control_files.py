"""The configuration for ros2_control names joints, interfaces and topics that there are."""

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from rpud_sim.drilling.mount import MountParameters
from rpud_sim.simulation.fields import FEED_JOINT
from rpud_sim.simulation.topics import TOPICS

pytestmark = pytest.mark.extended

ROOT = Path(__file__).resolve().parents[1]
MACRO_FILE = ROOT / "config" / "ros2_control" / "rpud.ros2_control.xacro"
MACRO = ElementTree.parse(MACRO_FILE).getroot()[0]
DEFAULTS = dict(word.split(":=") for word in MACRO.get("params").split())
# Of joint_state_topic_hardware_interface 1.1.0, read from its sources.
PARAMETERS = {
    "joint_commands_topic",
    "joint_states_topic",
    "trigger_joint_command_threshold",
    "sum_wrapped_joint_states",
}
CONTROLLERS = yaml.safe_load((ROOT / "config" / "ros2_control" / "controllers.yaml").read_text())
PAGE = ROOT / "docs" / "how-to" / "put-it-on-an-arm.md"


class Description:
    """System of a `ros2_control` element in a whole robot description."""

    def __init__(self, robot):
        (system,) = robot.findall("ros2_control")
        assert system.get("name")
        assert system.get("type") == "system"
        assert {child.tag for child in system} == {"hardware", "joint"}
        hardware = system.find("hardware")
        self.plugin = hardware.find("plugin").text
        self.parameters = {each.get("name"): each.text for each in hardware.findall("param")}
        moving = {joint.get("name"): joint for joint in robot.findall("joint")}
        self.joints = {}  # command and state interfaces of each joint
        self.limits = {}  # of each joint in the URDF, as its attributes
        for joint in system.findall("joint"):
            name = joint.get("name")
            assert moving[name].get("type") != "fixed"
            self.joints[name] = tuple(
                tuple(each.get("name") for each in joint.findall(f"{kind}_interface"))
                for kind in ("command", "state")
            )
            self.limits[name] = dict(moving[name].find("limit").attrib)


def expanded(**arguments):
    """Return the ros2_control element as xacro expands the macro."""
    values = {**DEFAULTS, **arguments}
    text = ElementTree.tostring(MACRO[0], encoding="unicode")
    return ElementTree.fromstring(re.sub(r"\$\{(\w+)\}", lambda found: values[found[1]], text))


def arm_with_drill(**arguments):
    """Return a whole description: an arm's flange, both files of the drill, and ros2_control."""
    robot = ElementTree.fromstring('<robot name="arm"><link name="tool0"/></robot>')
    for name in ("rpud.urdf", "rpud_feed.urdf"):
        robot.extend(ElementTree.parse(ROOT / "urdf" / name).getroot())
    robot.append(
        ElementTree.fromstring(
            '<joint name="drill_joint" type="fixed"><parent link="tool0"/>'
            '<child link="rpud_rail"/></joint>'
        )
    )
    robot.append(expanded(**arguments))
    return robot


def test_the_hardware_talks_on_the_topics_of_the_drill():
    description = Description(arm_with_drill(drill="/mine"))
    assert description.plugin == "joint_state_topic_hardware_interface/JointStateTopicSystem"
    parameters = description.parameters
    assert set(parameters) <= PARAMETERS
    assert parameters["joint_states_topic"] == "/mine/joint_states"
    assert parameters["joint_commands_topic"] == "/mine/joint_commands"
    assert "joint_states" in TOPICS
    # A rate of penetration is some micrometres a second: the threshold must not hide one.
    assert float(parameters["trigger_joint_command_threshold"]) <= 1e-7


def types():
    manager = CONTROLLERS["controller_manager"]["ros__parameters"]
    return {name: each["type"] for name, each in manager.items() if isinstance(each, dict)}


def test_each_controller_uses_interfaces_of_the_description():
    modes = {}
    for name in set(types()) - {"joint_state_broadcaster"}:
        given = CONTROLLERS[name]["ros__parameters"]
        assert given.get("joints", given.get("dof_names")) == [FEED_JOINT]
        (mode,) = given.get("command_interfaces") or [
            given.get("command_interface") or given["interface_name"]
        ]
        modes[name] = mode
        commands, states = Description(arm_with_drill(feed_command=mode)).joints[FEED_JOINT]
        assert mode in commands
        wanted = given.get("state_interfaces") or given.get("reference_and_state_interfaces", [])
        assert set(wanted) <= set(states)
    assert modes == {
        "feed_rate_controller": "velocity",
        "feed_force_controller": "velocity",
        "feed_trajectory_controller": "position",
    }


def test_the_force_controller_asks_for_no_rate_that_the_drill_rejects():
    gains = CONTROLLERS["feed_force_controller"]["ros__parameters"]["gains"][FEED_JOINT]
    limit = MountParameters().feed_rate_limit
    assert (gains["u_clamp_max"], gains["u_clamp_min"]) == (limit, -limit)
    assert float(Description(arm_with_drill()).limits[FEED_JOINT]["velocity"]) == limit


def canonical(element):
    return ElementTree.canonicalize(
        ElementTree.tostring(element, encoding="unicode"), strip_text=True
    )


def test_xacro_expands_the_snippets_of_the_page(optional_packages, tmp_path):
    """The real xacro, on the page's own text, gives the description that the other tests use."""
    snippets = re.findall(r"```xml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    chosen = [
        snippet for snippet in snippets if "rpud_feed" in snippet or "ros2_control" in snippet
    ]
    assert len(chosen) == 2
    arm = tmp_path / "arm.urdf.xacro"
    arm.write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="tool0"/>'
        f"{''.join(chosen)}</robot>"
    )
    done = subprocess.run(
        [sys.executable, "-c", "import xacro; xacro.main()", arm],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    robot = ElementTree.fromstring(done.stdout)
    own = arm_with_drill()
    for threshold in own.iter("param"):  # xacro reads numbers, and writes them in its own way
        if threshold.get("name") == "trigger_joint_command_threshold":
            threshold.text = str(float(threshold.text))
    assert canonical(robot) == canonical(own)
    assert Description(robot).joints == Description(own).joints
    assert canonical(expanded()) != canonical(expanded(feed_command="position"))
