"""Numbers of many messages at once: the same as those of each message decoded by itself."""

import dataclasses

from hypothesis import given
from hypothesis import strategies as st
from sample_bags import EVERYTHING, MESSAGE, serialized

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.stack import Stack

TYPE = "pkg/msg/Everything"
WANTED = ("stamp.sec", "stamp.nanosec", "part.x", "good", "small", "large", "log_time")
CODEC = Codec(TYPE, EVERYTHING)

FIELDS = st.fixed_dictionaries(
    {
        "part": st.fixed_dictionaries({"x": st.floats(), "turn": st.floats()}),
        "parts": st.lists(st.just({"x": 1.0, "turn": 2.0}), max_size=2),
        "names": st.lists(st.text("ab", max_size=3), max_size=2),
        "note": st.text("größer", max_size=5),
        "good": st.booleans(),
        "small": st.integers(-128, 127),
        "large": st.integers(0, 2**64 - 1),
        "log_time": st.floats(),
    }
)


def attribute(message, path):
    for name in path.split("."):
        message = getattr(message, name)
    return message


@given(st.lists(FIELDS, max_size=6))
def test_numbers_are_those_of_the_decoded_messages(many):
    messages = [serialized(TYPE, EVERYTHING, {**MESSAGE, **fields}) for fields in many]
    found = Stack(CODEC, WANTED).numbers(messages)
    assert found.rows.tolist() == [*range(len(messages))]
    assert found.unreadable == 0
    for name in WANTED:
        expected = [attribute(CODEC.decode(data), name) for data in messages]
        assert str(found.columns[name].tolist()) == str([*map(type_of(name), expected)]), name


def type_of(name):
    return {"part.x": float, "log_time": float}.get(name, int)


@given(st.lists(st.binary(max_size=40), max_size=5), st.integers(0, 300))
def test_what_is_no_message_is_counted(others, cut):
    whole = serialized(TYPE, EVERYTHING, MESSAGE)
    cut = min(cut, len(whole) - 1)
    found = Stack(CODEC, WANTED).numbers([whole, *others, whole[:cut], whole])
    assert len(found.rows) + found.unreadable == len(others) + 3
    assert {0, len(others) + 2} <= set(found.rows.tolist())
    if found.unreadable:
        assert found.reason
    assert dataclasses.is_dataclass(found)
