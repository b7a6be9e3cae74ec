"""The codec reads the messages of ROS; test_encoder.py shows that it writes them."""

from array import array

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from rpud_msgs.msg import DrillTool, Status, Trajectory, Waveform
from std_msgs.msg import Header

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash

HEADER = Header(stamp=Time(sec=3, nanosec=999_999_999), frame_id="rpud_tool_tip")


def sequences(message):
    """Return three values for every sequence of numbers in a message."""
    codes = {"sequence<double>": "d", "sequence<int64>": "q", "sequence<uint8>": "B"}
    kinds = type(message).get_fields_and_field_types()
    return {name: array(codes[kind], [0, 2, 7]) for name, kind in kinds.items() if kind in codes}


MESSAGES = [
    DrillTool(header=HEADER, displacement=1e-6, velocity=-2.5, in_contact=True),
    Status(header=HEADER, state="running", regime="free", impacts=7, drive_applied=HEADER.stamp),
    Trajectory(header=HEADER, sequence=2**64 - 1, gravity=-0.1),
    Waveform(header=HEADER, sample_period=2e-5),
    WrenchStamped(header=HEADER),
]
for each in MESSAGES:
    for name, numbers in sequences(each).items():
        setattr(each, name, numbers)
every_message = pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)


def type_name(message):
    return f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"


def codec(message):
    return Codec(type_name(message), find_definition(type_name(message)))


def plain(value):
    """Return the plain values of a ROS message for the codec."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    return value


@every_message
def test_what_ros_writes_is_decoded(message):
    def same(decoded, expected):
        if isinstance(expected, dict):
            return all(same(getattr(decoded, name), expected[name]) for name in expected)
        return np.array_equal(decoded, expected)

    assert same(codec(message).decode(serialize_message(message)), plain(message))


@every_message
def test_the_hash_is_that_of_the_installed_description(message):
    assert codec(message).type_hash == find_type_hash(type_name(message))
