"""The encoder writes the bytes of ROS for every message, and the codec reads them."""

import dataclasses
import struct
from array import array

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from rosidl_parser.definition import AbstractSequence, NamespacedType, UnboundedString
from rpud_msgs.msg import (
    ActuatorState,
    Borehole,
    ContactForce,
    DrillTool,
    Faults,
    JournalEntry,
    Mount,
    NodalPlane,
    ReactingForce,
    Rotation,
    Status,
    Trajectory,
    Waveform,
)
from sensor_msgs.msg import JointState

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.encoder import CODES, Encoder
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.foundation.ragged import Ragged
from rpud_sim.ros.graph import members_of, message_class
from rpud_sim.simulation.topics import TOPICS

# Listed, so that none is left out by mistake.
KINDS = [ContactForce, DrillTool, Faults, JointState, JournalEntry, NodalPlane, ReactingForce]
KINDS += [ActuatorState, Status, Trajectory, Waveform, WrenchStamped, Clock]
KINDS += [Borehole, Mount, Rotation]

HEADER = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}

NUMBERS = {
    "boolean": st.booleans(),
    "double": st.floats(),
    "int32": st.integers(-(2**31), 2**31 - 1),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "uint8": st.integers(0, 2**8 - 1),
    "uint32": st.integers(0, 2**32 - 1),
    "uint64": st.integers(0, 2**64 - 1),
}


def type_name(kind):
    return f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"


def values_of(slot):
    """Strategy for plain values of a message class or of a member."""
    if hasattr(slot, "SLOT_TYPES"):
        names = slot.get_fields_and_field_types()
        members = zip(names, map(values_of, slot.SLOT_TYPES), strict=True)
        return st.fixed_dictionaries(dict(members))
    if isinstance(slot, NamespacedType):
        return values_of(message_class("/".join([*slot.namespaces, slot.name])))
    if isinstance(slot, UnboundedString):
        return st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=9)
    if isinstance(slot, AbstractSequence):
        several = st.lists(values_of(slot.value_type), max_size=4)
        code = CODES.get(getattr(slot.value_type, "typename", ""))
        return several.map(lambda values: array(code, values)) if code else several
    return NUMBERS[slot.typename]


def message_of(kind, values):
    """Return the ROS message."""
    content = {}
    for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        value = values[name]
        inner = slot.value_type if isinstance(slot, AbstractSequence) else slot
        if isinstance(inner, NamespacedType):
            make = message_class("/".join([*inner.namespaces, inner.name]))
            several = isinstance(value, list)
            value = [message_of(make, v) for v in value] if several else message_of(make, value)
        content[name] = value
    return kind(**content)


def test_every_topic_is_here():
    published = {message_class(topic.type) for topic in TOPICS.values()}
    assert published | {Clock} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25)
@given(st.data())
def test_the_bytes_are_those_of_ros(kind, data):
    encoder = Encoder(members_of(kind))
    codec = Codec(type_name(kind), find_definition(type_name(kind)))
    assert codec.type_hash == find_type_hash(type_name(kind))
    for values in data.draw(st.lists(values_of(kind), min_size=1, max_size=3)):
        content = encoder.encode(values)
        expected = serialize_message(message_of(kind, values))
        # ROS leaves what lies between members, and a few bytes behind, as it was in memory.
        assert content == codec.without_padding(expected)
        assert repr(deserialize_message(content, kind)) == repr(message_of(kind, values))
        assert content == codec.encode(values)
        assert content == codec.encode(dataclasses.asdict(codec.decode(content)))


def test_a_message_of_another_length_is_not_decoded():
    codec = Codec("sensor_msgs/msg/JointState", find_definition("sensor_msgs/msg/JointState"))
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
                columns[name] = Ragged(values, np.cumsum([0, *counts]))
        else:
            whole = np.uint64 if isinstance(value, int) and max(own) >= 2**63 else None
            columns[name] = value if isinstance(value, (str, list)) else np.array(own, whole)
    return columns


@pytest.mark.parametrize("kind", [ReactingForce, JointState, Trajectory])
@settings(max_examples=25)
@given(st.data(), st.booleans())
def test_columns_have_the_bytes_of_single_messages(kind, data, ragged):
    encoder = Encoder(members_of(kind))
    first = data.draw(values_of(kind))
    rows = [first]
    for _ in range(data.draw(st.integers(0, 4))):
        other = data.draw(values_of(kind))
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


def test_sequences_of_different_lengths_may_all_be_empty():
    encoder = Encoder(members_of(JointState))
    lists = {"name": [], "velocity": array("d"), "effort": array("d")}
    columns = {"header": HEADER, **lists, "position": Ragged(np.empty(0), np.zeros(3, np.int64))}
    encoded, _ = encoder.encode_columns(columns, 2)
    assert encoded.tobytes() == 2 * encoder.encode({**columns, "position": array("d")})


def test_a_column_that_does_not_fit_is_an_error():
    header = {"stamp": {"sec": np.array([1, 2**31]), "nanosec": np.array([0, 0])}, "frame_id": ""}
    with pytest.raises(ValueError, match="does not fit int32"):
        Encoder(members_of(ReactingForce)).encode_columns({"header": header, "force": 1.0}, 2)


@pytest.mark.parametrize(
    ("values", "error"),
    [
        ({"header": HEADER}, KeyError),
        ({"header": HEADER, "force": "1"}, struct.error),
        ({"header": {**HEADER, "frame_id": 1}, "force": 1.0}, AttributeError),
        ({"header": {**HEADER, "stamp": {"sec": 2**31, "nanosec": 0}}, "force": 1.0}, struct.error),
    ],
)
def test_what_does_not_fit_is_an_error(values, error):
    with pytest.raises(error):
        Encoder(members_of(ReactingForce)).encode(values)


@pytest.mark.parametrize("numbers", [array("f", [1.0]), array("q", [1]), [1.0]])
def test_numbers_of_another_kind_are_not_taken_for_theirs(numbers):
    values = {"header": HEADER, "name": [], "position": numbers}
    values |= {"velocity": array("d"), "effort": array("d")}
    with pytest.raises(TypeError, match="array of 'd'"):
        Encoder(members_of(JointState)).encode(values)
