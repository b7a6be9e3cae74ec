"""Message classes are found by name, and what is missing is named."""

import pytest
from geometry_msgs.msg import PoseWithCovariance
from rpud_msgs.msg import Fault, Faults

from rpud_sim.bag.encoder import TEXT, Sequence
from rpud_sim.ros.graph import UnknownTypeError, members_of, message_class


@pytest.mark.parametrize(
    "name", ["nowhere_msgs/msg/Thing", "std_msgs/msg/Thing", "std_msgs/String", "json/msg/JSON", ""]
)
def test_another_type_is_named(name):
    with pytest.raises(UnknownTypeError, match=name or "''"):
        message_class(name)


def test_members_are_found_through_messages_and_sequences():
    members = dict(members_of(Faults).members)
    assert list(members) == ["header", "faults", "forgotten"]
    assert dict(members["header"].members)["frame_id"] == TEXT
    assert members["faults"] == Sequence(members_of(Fault))


def test_a_member_that_no_message_of_ours_has_is_named():
    with pytest.raises(UnknownTypeError, match=r"double\[36\]"):
        members_of(PoseWithCovariance)
