"""The configuration for ros2_control names joints, interfaces and topics that there are."""

import re
from pathlib import Path
from xml.etree import ElementTree

import yaml

from rpud_sim.simulation.process_fields import FEED_JOINT, ROTATION_JOINT
from rpud_sim.simulation.topics import TOPICS

FOLDER = Path(__file__).resolve().parent.parent / "config" / "ros2_control"
MACRO = ElementTree.parse(FOLDER / "rpud.ros2_control.xacro").getroot()[0]
DEFAULTS = dict(word.split(":=") for word in MACRO.get("params").split())
CONTROLLERS = yaml.safe_load((FOLDER / "controllers.yaml").read_text())


def expanded(**arguments):
    """Give the ros2_control element as xacro would expand the macro."""
    values = {**DEFAULTS, **arguments}
    text = ElementTree.tostring(MACRO[0], encoding="unicode")
    return ElementTree.fromstring(re.sub(r"\$\{(\w+)\}", lambda found: values[found[1]], text))


def test_the_hardware_talks_on_the_topics_of_the_drill():
    hardware = expanded(drill="/mine").find("hardware")
    assert (
        hardware.find("plugin").text == "joint_state_topic_hardware_interface/JointStateTopicSystem"
    )
    parameters = {each.get("name"): each.text for each in hardware.findall("param")}
    assert parameters["joint_states_topic"] == "/mine/joint_states"
    assert parameters["joint_commands_topic"] == "/mine/joint_commands"
    assert "joint_states" in TOPICS
    # A rate of penetration is some micrometres a second: the threshold must not hide one.
    assert float(parameters["trigger_joint_command_threshold"]) <= 1e-7


def test_only_the_feed_takes_commands_and_it_is_named_first():
    for mode in ("velocity", "position"):
        joints = expanded(feed_command=mode).findall("joint")
        assert [joint.get("name") for joint in joints] == [FEED_JOINT, ROTATION_JOINT]
        commands = [
            [each.get("name") for each in joint.findall("command_interface")] for joint in joints
        ]
        assert commands == [[mode], []]
        for joint in joints:  # the hardware sets all that a message has
            states = [each.get("name") for each in joint.findall("state_interface")]
            assert states == ["position", "velocity", "effort"]


def test_each_controller_has_a_type_and_commands_the_feed():
    manager = CONTROLLERS["controller_manager"]["ros__parameters"]
    types = {name: each["type"] for name, each in manager.items() if isinstance(each, dict)}
    assert types.pop("joint_state_broadcaster").endswith("/JointStateBroadcaster")
    for name in types:
        parameters = CONTROLLERS[name]["ros__parameters"]
        assert parameters.get("joints", parameters.get("dof_names")) == [FEED_JOINT]
