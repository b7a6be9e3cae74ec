"""The robot description has the joints that are asked for, and stays one tree."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

from rpud_sim.ros.process import robot_description
from rpud_sim.simulation.fields import FEED_JOINT, JOINTS, ROTATION_JOINT

FOLDER = Path(__file__).resolve().parents[2] / "urdf"


def moving(robot):
    """Give the names of the joints that need a publisher."""
    return {each.get("name") for each in robot.findall("joint") if each.get("type") != "fixed"}


def names(robot):
    """Give every name of a frame or joint in a robot description."""
    parts = [*robot.findall("link"), *robot.findall("joint")]
    ends = [*robot.findall("joint/parent"), *robot.findall("joint/child")]
    return [*(each.get("name") for each in parts), *(each.get("link") for each in ends)]


def test_a_prefix_is_in_front_of_every_frame_and_joint():
    plain, prefixed = (
        ElementTree.fromstring(robot_description(FOLDER, True, True, prefix))
        for prefix in ("", "left/")
    )
    assert names(prefixed) == [f"left/{name}" for name in names(plain)]


@pytest.mark.parametrize("feed", [False, True])
@pytest.mark.parametrize("rotation", [False, True])
def test_it_has_the_joints_that_a_drill_publishes(feed, rotation):
    robot = ElementTree.fromstring(robot_description(FOLDER, feed, rotation))
    wanted = {FEED_JOINT: feed, ROTATION_JOINT: rotation}
    assert moving(robot) == {*JOINTS, *(name for name, there in wanted.items() if there)}
    links = [link.get("name") for link in robot.findall("link")]
    assert len(links) == len(set(links))
    children = [joint.find("child").get("link") for joint in robot.findall("joint")]
    parents = [joint.find("parent").get("link") for joint in robot.findall("joint")]
    assert {*children, *parents} == set(links)
    assert set(links) - set(children) == {"rpud_rail" if feed else "rpud_base"}
    materials = {each.get("name") for each in robot.findall("material")}
    assert {each.get("name") for each in robot.iter("material")} <= materials
