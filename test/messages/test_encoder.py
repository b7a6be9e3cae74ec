"""The encoder writes the bytes of ROS for every message, and the codec reads them."""

import struct
from array import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from support import examples

from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.definitions import find_type_hash, installed_codec
from rpud_sim.messages.encoder import CODES, TEXT, Encoder, Members, Sequence
from rpud_sim.messages.errors import BagFormatError
from rpud_sim.ros.graph import members_of, message_class
from rpud_sim.simulation.topics import TOPICS

HEADER = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
KINDS = sorted({topic.type for topic in TOPICS.values()} | {"rosgraph_msgs/msg/Clock"})
FORCE, JOINTS = "rpud_msgs/msg/ReactingForce", "sensor_msgs/msg/JointState"
TRAJECTORY = "rpud_msgs/msg/Trajectory"

NUMBERS = {
    CODES["bool"]: st.booleans(),
    CODES["float64"]: st.floats(),
    CODES["int32"]: st.integers(-(2**31), 2**31 - 1),
    CODES["int64"]: st.integers(-(2**63), 2**63 - 1),
    CODES["uint8"]: st.integers(0, 2**8 - 1),
    CODES["uint32"]: st.integers(0, 2**32 - 1),
    CODES["uint64"]: st.integers(0, 2**64 - 1),
    CODES["string"]: st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=9),
}


def values_of(members):
    """Strategy for plain values of a message."""
    return st.fixed_dictionaries({name: value_of(node) for name, node in members.members})


def value_of(node):
    if isinstance(node, Members):
        return values_of(node)
    if isinstance(node, str):
        return NUMBERS[node]
    several = st.lists(value_of(node.element), max_size=4)
    if isinstance(node.element, Members) or node.element == TEXT:
        return several
    return several.map(lambda values: array(node.element, values))


def message_of(members, values):
    """Return the ROS message."""
    content = {**values}
    for name, node in members.members:
        if isinstance(node, Members):
            content[name] = message_of(node, values[name])
        elif isinstance(node, Sequence) and isinstance(node.element, Members):
            content[name] = [message_of(node.element, each) for each in values[name]]
    return message_class(members.name)(**content)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(25))
@given(st.data())
def test_the_bytes_are_those_of_ros(kind, data):
    codec, of_ros = installed_codec(kind), Encoder(members_of(message_class(kind)))
    assert codec.type_hash == find_type_hash(kind)
    for values in data.draw(
        st.lists(values_of(installed_codec(kind).members), min_size=1, max_size=3)
    ):
        message = message_of(codec.members, values)
        content = codec.encode(values)
        assert content == of_ros.encode(values)
        # ROS leaves what lies between members, and a few bytes behind, as it was in memory.
        assert content == codec.encode(codec.decode(serialize_message(message)))
        assert repr(deserialize_message(content, type(message))) == repr(message)
        assert content == codec.encode(codec.decode(content))


def test_a_type_with_arrays_of_a_fixed_length_is_read_alone():
    codec = installed_codec("geometry_msgs/msg/PoseWithCovariance")
    with pytest.raises(BagFormatError, match="no message with a member"):
        codec.encode({})


def test_a_message_of_another_length_is_not_decoded():
    codec = installed_codec(JOINTS)
    with pytest.raises(BagFormatError, match="bytes follow its last field"):
        codec.decode(serialize_message(JointState(name=["a"]))[:40] + bytes(40))


def columns_of(rows):
    """Columns of messages whose texts and lists are those of the first one."""
    first = rows[0]
    columns = {}
    for name, value in first.items():
        own = [row[name] for row in rows]
        if isinstance(value, dict):
            columns[name] = columns_of(own)
        elif isinstance(value, array):
            counts = [len(each) for each in own]
            if len({*counts}) == 1:
                columns[name] = np.array([each.tolist() for each in own], value.typecode)
                columns[name] = columns[name].reshape(len(own), len(value))
            else:
                values = np.array([v for each in own for v in each.tolist()], value.typecode)
                columns[name] = Sequences(values, np.cumsum([0, *counts]))
        else:
            whole = np.uint64 if isinstance(value, int) and max(own) >= 2**63 else None
            columns[name] = value if isinstance(value, (str, list)) else np.array(own, whole)
    return columns


@pytest.mark.parametrize("kind", [FORCE, JOINTS, TRAJECTORY])
@settings(max_examples=examples(25))
@given(st.data(), st.booleans())
def test_columns_have_the_bytes_of_single_messages(kind, data, ragged):
    encoder = installed_codec(kind).encoder
    first = data.draw(values_of(installed_codec(kind).members))
    rows = [first]
    for _ in range(data.draw(st.integers(0, 4))):
        other = data.draw(values_of(installed_codec(kind).members))
        rows.append(mixed(first, other, ragged))
    encoded, sizes = encoder.encode_columns(columns_of(rows), len(rows))
    assert np.split(encoded, np.cumsum(sizes))[-1].size == 0
    found = [part.tobytes() for part in np.split(encoded, np.cumsum(sizes))[:-1]]
    assert found == [encoder.encode(row) for row in rows]


def mixed(first, other, ragged):
    """A message with the numbers of another one, and texts of the first.

    Sequences have the lengths of the first, or with ``ragged`` those of the other one.
    """
    found = {}
    for name, value in first.items():
        if isinstance(value, dict):
            found[name] = mixed(value, other[name], ragged)
        elif isinstance(value, array):
            found[name] = other[name] if ragged else array(value.typecode, reversed(value))
        else:
            found[name] = value if isinstance(value, (str, list)) else other[name]
    return found


LATE = {**HEADER, "stamp": {"sec": 2**31, "nanosec": 0}}
LISTS = {"header": HEADER, "name": [], "velocity": array("d"), "effort": array("d")}


@pytest.mark.parametrize(
    ("kind", "values", "error"),
    [
        (FORCE, {"header": HEADER}, KeyError),
        (FORCE, {"header": HEADER, "force": "1", "impacts": 0}, struct.error),
        (FORCE, {"header": {**HEADER, "frame_id": 1}, "force": 1.0, "impacts": 0}, AttributeError),
        (FORCE, {"header": LATE, "force": 1.0, "impacts": 0}, struct.error),
        (JOINTS, {**LISTS, "position": array("f", [1.0])}, TypeError),
        (JOINTS, {**LISTS, "position": [1.0]}, TypeError),
    ],
)
def test_what_does_not_fit_is_an_error(kind, values, error):
    with pytest.raises(error):
        installed_codec(kind).encode(values)


def test_a_column_that_does_not_fit_is_an_error():
    header = {"stamp": {"sec": np.array([1, 2**31]), "nanosec": np.array([0, 0])}, "frame_id": ""}
    fields = {"header": header, "force": 1.0, "impacts": 0}
    with pytest.raises(ValueError, match="does not fit int32"):
        installed_codec(FORCE).encoder.encode_columns(fields, 2)
