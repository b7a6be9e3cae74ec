"""Fast topics: decoding of raw messages, whatever a stranger sends."""

from contextlib import suppress

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rpud_msgs.msg import ReactingForce

from rpud_sim.bag import BagFormatError
from rpud_sim.ros.client.telemetry import _TYPES, FIELDS, decoded

STAMP = Time(sec=7, nanosec=9)


@pytest.mark.parametrize("topic", _TYPES)
@given(
    frame=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=12),
    length=st.integers(0, 5),
)
def test_values_are_those_of_the_message(topic, frame, length):
    kind = _TYPES[topic]
    message = kind()
    message.header.stamp, message.header.frame_id = STAMP, frame
    names = FIELDS.get(topic, tuple(kind.get_fields_and_field_types())[1:])
    for number, name in enumerate(names, 1):
        before = getattr(message, name)
        many = hasattr(before, "tolist")
        setattr(message, name, [float(number)] * length if many else type(before)(number))
    stamp, values = decoded(kind, bytes(serialize_message(message)))
    assert stamp == 7_000_000_009
    for name, value in zip(names, values, strict=True):
        np.testing.assert_array_equal(value, getattr(message, name))


@pytest.mark.parametrize("change", [lambda data: b"\0\2" + data[2:], lambda data: data + bytes(8)])
def test_another_encapsulation_or_version_of_a_type_is_no_value(change):
    data = bytes(serialize_message(ReactingForce(force=3.0)))
    assert decoded(ReactingForce, data)[1] == (3.0,)
    with pytest.raises(BagFormatError):
        decoded(ReactingForce, change(data))


@given(st.binary(max_size=300))
def test_other_bytes_are_no_message_and_nothing_worse(data):
    for kind in _TYPES.values():
        with suppress(BagFormatError):
            decoded(kind, data)
