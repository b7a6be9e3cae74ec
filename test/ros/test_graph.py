"""Message classes are found by name, and what is missing is named."""

import pytest
from std_msgs.msg import String

from rpud_sim.ros.graph import UnknownTypeError, message_class


def test_an_installed_type_is_found():
    assert message_class("std_msgs/msg/String") is String


@pytest.mark.parametrize(
    "name", ["nowhere_msgs/msg/Thing", "std_msgs/msg/Thing", "std_msgs/String", "json/msg/JSON", ""]
)
def test_another_type_is_named(name):
    with pytest.raises(UnknownTypeError, match=name or "''"):
        message_class(name)
