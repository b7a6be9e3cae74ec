"""Robot descriptions of an arm with the drill, as xacro makes them, and without xacro."""

import re
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
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
