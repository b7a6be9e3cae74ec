"""Joint commands of ros2_control: which of them feed, and why the others are refused."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.gate import to_feed
from rpud_sim.simulation.commands import Feed

NAN = math.nan
FEED, ROTATION = "rpud_feed", "rpud_rotation"


@pytest.mark.parametrize(
    ("message", "feed"),
    [
        # As the hardware interface sends it: all joints, and a value for one of them.
        (JointState(name=[FEED, ROTATION], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED, ROTATION], position=[0.02]), Feed("position", 0.02)),
        (JointState(name=[FEED], position=[NAN], velocity=[1e-3]), Feed("rate", 1e-3)),
        (JointState(name=["elbow", FEED], velocity=[7.0, 1e-3]), Feed("rate", 1e-3)),
        (JointState(name=[FEED], velocity=[NAN]), None),
        (JointState(name=[FEED, ROTATION]), None),
        (JointState(name=["elbow"], position=[1.0]), None),
        (JointState(), None),
    ],
)
def test_a_command_feeds_or_is_none(message, feed):
    assert to_feed(message) == feed


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (
            JointState(name=[ROTATION, FEED], velocity=[1e-3]),
            "joint_commands: velocity has length 1 for 2 joints, of which rpud_feed is number 2: "
            "name it first",
        ),
        (JointState(name=[FEED], position=[0.0, 1.0]), "position has length 2 for 1 joints"),
        (JointState(name=[FEED, FEED], velocity=[0.0, 0.0]), "rpud_feed is named twice"),
        (
            JointState(name=[FEED], position=[0.02], velocity=[1e-3]),
            "takes a position or a velocity, given 0.02 m and 0.001 m/s",
        ),
        (JointState(name=[FEED], effort=[5.0]), "takes no effort, given 5"),
        (JointState(name=[ROTATION], velocity=[5.0]), "rpud_rotation cannot be commanded"),
        (JointState(name=["rpud_tool_tip_joint"], effort=[5.0]), "cannot be commanded"),
        (JointState(name=[FEED], velocity=[math.inf]), "feed rate = inf m/s is outside its range"),
        (JointState(name=[FEED], position=[2.0]), "feed position = 2 m is outside its range"),
    ],
)
def test_a_command_is_refused_with_its_reason_in_one_line(message, reason):
    with pytest.raises(ParameterError) as refused:
        to_feed(message)
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


NAMES = st.lists(st.sampled_from([FEED, ROTATION, "elbow", "rpud_nodal_plane_joint"]), max_size=4)
VALUES = st.lists(st.floats(), max_size=5)


@given(NAMES, VALUES, VALUES, VALUES)
def test_any_message_feeds_is_none_or_is_refused(names, position, velocity, effort):
    message = JointState(name=names, position=position, velocity=velocity, effort=effort)
    with suppress(ParameterError):
        feed = to_feed(message)
        assert feed is None or feed.value in [*position, *velocity]
