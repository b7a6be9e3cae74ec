"""The URDF describes the drill that is simulated: its frames, joints, masses and sections."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from rpud_sim.simulation import preset
from rpud_sim.simulation.fields import FEED_JOINT, JOINTS, ROTATION_JOINT
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import MOUNT_FRAME, NODAL_PLANE_FRAME, TOOL_TIP_FRAME

ROOT = Path(__file__).resolve().parent.parent
ROBOT = ElementTree.parse(ROOT / "urdf" / "rpud.urdf").getroot()
LINKS = {link.get("name"): link for link in ROBOT.findall("link")}
JOINT = {joint.get("name"): joint for joint in ROBOT.findall("joint")}
PARAMETERS = preset("drilling")
FREE_MASS_FRAME = "rpud_free_mass"


def numbers(element, name):
    text = "0 0 0" if element is None else element.get(name, "0 0 0")
    return [float(word) for word in text.split()]


def height(element):
    """Give how far along z an element is from the frame it is given in, with parallel axes."""
    origin = element.find("origin")
    x, y, z = numbers(origin, "xyz")
    assert (x, y) == (0.0, 0.0)
    assert numbers(origin, "rpy") == [0.0, 0.0, 0.0]
    return z


def cylinders(link, kind="visual"):
    """Give the cylinders of a link as (radius, length, height of the middle), along z."""
    found = []
    for element in LINKS[link].findall(kind):
        cylinder = element.find("geometry/cylinder")
        if cylinder is not None:
            size = float(cylinder.get("radius")), float(cylinder.get("length"))
            found.append((*size, height(element)))
    return sorted(found, key=lambda cylinder: cylinder[2])


def test_each_joint_that_moves_is_published_and_carries_the_frame_of_the_messages():
    moving = {
        name: joint.find("child").get("link")
        for name, joint in JOINT.items()
        if joint.get("type") == "prismatic"
    }
    frames = (NODAL_PLANE_FRAME, FREE_MASS_FRAME, TOOL_TIP_FRAME)
    assert moving == dict(zip(JOINTS, frames, strict=True))
    # An arm attaches at the mount, whose axis is the drill's.
    base = JOINT["rpud_base_joint"]
    assert (base.get("type"), base.find("child").get("link")) == ("fixed", MOUNT_FRAME)
    assert height(base) == 0.0
    # A root with an inertia is what robot_state_publisher complains of.
    assert LINKS["rpud_base"].find("inertial") is None
    for name in JOINTS:
        assert JOINT[name].find("parent").get("link") == MOUNT_FRAME
        assert numbers(JOINT[name].find("axis"), "xyz") == [0.0, 0.0, 1.0]


def test_the_bodies_just_touch_where_every_joint_is_zero():
    faces = []
    for name in JOINTS:
        base = height(JOINT[name])
        parts = cylinders(JOINT[name].find("child").get("link"))
        faces.append((base + parts[0][2] - parts[0][1] / 2, base + parts[-1][2] + parts[-1][1] / 2))
    (_, actuator_tip), (top, bottom), (tool_face, tool_end) = faces
    assert actuator_tip == pytest.approx(top, abs=1e-12)
    assert bottom == pytest.approx(tool_face, abs=1e-12)
    assert tool_end == pytest.approx(height(JOINT[JOINTS[2]]), abs=1e-12)


def test_the_drill_tool_has_the_sections_of_the_paper():
    sections = [
        (PARAMETERS.section_1_area, PARAMETERS.section_1_length),
        (PARAMETERS.section_2_area, PARAMETERS.section_2_length),
    ]
    for kind in ("visual", "collision"):
        found = [(math.pi * r * r, length) for r, length, _ in cylinders(TOOL_TIP_FRAME, kind)]
        assert np.array(found) == pytest.approx(np.array(sections), rel=1e-5)


@pytest.mark.parametrize("regime", ["free", "drilling"])
@pytest.mark.parametrize("weight_on_bit", [0.0, 100.0])
def test_the_limits_cover_what_the_drill_does(regime, weight_on_bit):
    """Ten seconds of the paper's drill, at every tenth of a millisecond."""
    simulation = Simulation(preset(regime).replace(weight_on_bit=weight_on_bit))
    samples = simulation.advance_to(10 * 10**9).sample(Times.from_grid(0, 100_000, 10_000))
    channels = (
        (samples.nodal_plane_position, samples.nodal_plane_velocity, samples.reacting_force),
        (samples.free_mass_position, samples.free_mass_velocity, 0.0),
        (samples.drill_tool_displacement, samples.drill_tool_velocity, 0.0),
    )
    for name, (position, velocity, effort) in zip(JOINTS, channels, strict=True):
        limit = JOINT[name].find("limit")
        assert np.min(position) > float(limit.get("lower"))
        assert np.max(position) < float(limit.get("upper"))
        assert np.max(np.abs(velocity)) < float(limit.get("velocity"))
        assert np.max(np.abs(effort)) < float(limit.get("effort"))


FEED = ElementTree.parse(ROOT / "urdf" / "rpud_feed.urdf").getroot()
FEED_JOINTS = {joint.get("name"): joint for joint in FEED.findall("joint")}


def ends(joint):
    return joint.find("parent").get("link"), joint.find("child").get("link")


def test_feed_and_rotation_extend_the_tree_at_its_root_and_at_the_tool():
    assert ends(FEED_JOINTS[FEED_JOINT]) == ("rpud_rail", "rpud_base")
    assert ends(FEED_JOINTS[ROTATION_JOINT]) == (TOOL_TIP_FRAME, "rpud_bit")
    for name, kind in ((FEED_JOINT, "prismatic"), (ROTATION_JOINT, "continuous")):
        joint = FEED_JOINTS[name]
        assert joint.get("type") == kind
        assert numbers(joint.find("axis"), "xyz") == [0.0, 0.0, 1.0]
        assert height(joint) == 0.0
