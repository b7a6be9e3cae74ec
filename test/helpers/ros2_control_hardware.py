"""Stand-in for the hardware interface of ros2_control that talks to a drill by topics.

It follows what `joint_state_topic_hardware_interface` 1.1.0 and `ros2_control` 4.46.0 do, read from
their sources: which parts of the description they take, which messages they send, and when.
"""

import math
import re
from pathlib import Path
from xml.etree import ElementTree

from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

# Of JointState: an interface of another name is never sent.
INTERFACES = ("position", "velocity", "effort")
PARAMETERS = {
    "joint_commands_topic",
    "joint_states_topic",
    "trigger_joint_command_threshold",
    "sum_wrapped_joint_states",
}
COMMAND_QOS = QoSProfile(depth=1)
STATE_QOS = qos_profile_sensor_data  # best effort


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


class Hardware:
    """States and commands of the joints of a system, with the messages between."""

    def __init__(self, client, description):
        self._joints = description.joints
        self._threshold = float(
            description.parameters.get("trigger_joint_command_threshold", "1e-5")
        )
        self.states = {(j, i): math.nan for j, (_, own) in self._joints.items() for i in own}
        self.commands = {(j, i): math.nan for j, (own, _) in self._joints.items() for i in own}
        self.sent = []
        self.heard = 0
        self._node = client.node
        topics = description.parameters
        self._publisher = client.node.create_publisher(
            JointState, topics["joint_commands_topic"], COMMAND_QOS
        )
        client.node.create_subscription(
            JointState, topics["joint_states_topic"], self._read, STATE_QOS
        )
        client.until(self._publisher.get_subscription_count)

    def _read(self, message):
        self.heard += 1
        for number, name in enumerate(message.name):
            if name not in self._joints:
                continue
            for interface in INTERFACES:
                values = getattr(message, interface)
                if len(values) and math.isfinite(values[number]):
                    assert (name, interface) in self.states
                    self.states[name, interface] = values[number]

    def write(self):
        """Publish the commands, as in each cycle, if they differ from the states by enough."""
        difference = sum(
            abs(self.states.get(key, math.nan) - command) for key, command in self.commands.items()
        )
        if difference <= self._threshold:  # never, while one is NaN
            return
        message = JointState(name=list(self._joints))
        message.header.stamp = self._node.get_clock().now().to_msg()
        for (_, interface), command in self.commands.items():
            getattr(message, interface).append(command)
        self.sent.append(message)
        self._publisher.publish(message)


ROOT = Path(__file__).resolve().parents[2]
MACRO_FILE = ROOT / "config" / "ros2_control" / "rpud.ros2_control.xacro"
MACRO = ElementTree.parse(MACRO_FILE).getroot()[0]
DEFAULTS = dict(word.split(":=") for word in MACRO.get("params").split())


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
