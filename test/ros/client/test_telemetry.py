"""Fast topics: decoding of raw messages, whatever a stranger sends."""

import struct
from contextlib import suppress

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rpud_msgs.msg import ReactingForce, Waveform

from rpud_sim.ros.client.telemetry import _LAYOUTS, _WAVEFORM, _decoder

STAMP = Time(sec=7, nanosec=9)


@pytest.mark.parametrize("topic", _LAYOUTS)
@given(frame=st.text(st.characters(codec="ascii", exclude_characters="\0"), max_size=12))
def test_values_are_those_of_the_message(topic, frame):
    kind, layout = _LAYOUTS[topic]
    message = kind()
    message.header.stamp, message.header.frame_id = STAMP, frame
    names = list(kind.get_fields_and_field_types())[1:]
    for number, name in enumerate(names, 1):
        setattr(message, name, type(getattr(message, name))(number))
    if topic == "borehole":
        message.layer = frame + "é"  # of any length: what follows it is aligned
    heard = []
    _decoder(lambda *each: heard.append(each), layout)(serialize_message(message))
    assert heard == [(7_000_000_009, tuple(getattr(message, name) for name in names))]


@pytest.mark.parametrize("change", [lambda data: b"\0\2" + data[2:], lambda data: data + bytes(8)])
def test_another_encapsulation_or_version_of_a_type_is_no_value(change):
    data = bytes(serialize_message(ReactingForce(force=3.0)))
    heard = []
    decode = _decoder(lambda *each: heard.append(each), "d")
    decode(data)
    with pytest.raises(ValueError, match="another"):
        decode(change(data))
    assert len(heard) == 1


@pytest.mark.parametrize("length", [0, 1, 5])
def test_a_waveform_is_six_arrays(length):
    message = Waveform(sequence=3, sample_period=2e-5)
    message.header.stamp, message.header.frame_id = STAMP, "rpud_mount"
    names = list(Waveform.get_fields_and_field_types())[3:]
    for number, name in enumerate(names):
        setattr(message, name, [float(number + each) for each in range(length)])
    heard = []
    _decoder(lambda *each: heard.append(each), _WAVEFORM)(serialize_message(message))
    [(stamp, (sequence, period, *arrays))] = heard
    assert (stamp, sequence, period) == (7_000_000_009, 3, 2e-5)
    for name, array in zip(names, arrays, strict=True):
        np.testing.assert_array_equal(array, getattr(message, name))


@given(st.binary(max_size=300))
def test_other_bytes_are_no_message_and_nothing_worse(data):
    heard = []
    for decode in [_decoder(heard.append, layout) for layout in ("dd", "dT5d", _WAVEFORM)]:
        with suppress(struct.error, ValueError, TypeError):  # TypeError is of `append`
            decode(data)
