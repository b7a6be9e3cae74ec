"""Message classes are found by name, and what is missing is named."""

import pytest
from geometry_msgs.msg import PoseWithCovariance

from rpud_sim.ros.graph import UnknownTypeError, members_of, message_class


@pytest.mark.parametrize(
    "name", ["nowhere_msgs/msg/Thing", "std_msgs/msg/Thing", "std_msgs/String", "json/msg/JSON", ""]
)
def test_another_type_is_named(name):
    with pytest.raises(UnknownTypeError, match=name or "''"):
        message_class(name)


def test_a_member_that_no_message_of_ours_has_is_named():
    with pytest.raises(UnknownTypeError, match=r"double\[36\]"):
        members_of(PoseWithCovariance)
