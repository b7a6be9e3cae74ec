"""Messages of any type become plain values; a path leads to a field or says why not."""

import json
import math

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovariance
from hypothesis import given, settings
from hypothesis import strategies as st
from rcl_interfaces.msg import ParameterDescriptor
from rpud_msgs.msg import Fault, Faults, Waveform
from sensor_msgs.msg import Image
from std_msgs.msg import Byte, ByteMultiArray, Header, String
from support import examples

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.values import finite_values
from rpud_sim.ros.client.topic_listener import CUT, field_getter, to_plain

FAULTS = Faults(
    header=Header(stamp=Time(sec=3)),
    faults=[Fault(kind="choking", magnitude=0.5), Fault(kind="noise", channel="wrench")],
)


def test_every_kind_of_field_becomes_plain():
    assert to_plain(FAULTS)["faults"][1]["channel"] == "wrench"
    assert to_plain(PoseWithCovariance())["covariance"] == [0.0] * 36
    assert to_plain(Byte(data=b"\x07")) == {"data": 7}
    assert to_plain(ByteMultiArray(data=[b"\x01", b"\xff"]))["data"] == [1, 255]
    assert to_plain(Image(data=b"\x00\x80"))["data"] == [0, 128]


def test_long_arrays_and_texts_are_cut_unless_all_is_wanted():
    shown = to_plain(Image(data=bytes(1000)), CUT)["data"]
    assert shown == [0] * CUT + ["..."]
    assert to_plain(String(data="x" * 200), CUT) == {"data": "x" * CUT + "..."}
    assert len(to_plain(Image(data=bytes(1000)))["data"]) == 1000
    assert to_plain(Image(data=bytes(CUT)), CUT)["data"] == [0] * CUT


@settings(max_examples=examples(30))
@given(st.lists(st.floats(width=64), max_size=5), st.text(max_size=5))
def test_json_has_every_message_with_null_for_what_is_no_number(values, text):
    faults = Faults(faults=[Fault(kind=text, magnitude=value) for value in values])
    line = json.dumps(finite_values(to_plain(faults)), allow_nan=False)
    read = json.loads(line)["faults"]
    assert [each["magnitude"] for each in read] == [
        value if math.isfinite(value) else None for value in values
    ]
    assert all(each["kind"] == text for each in read)


def test_a_path_leads_through_messages_and_arrays():
    assert field_getter("header.stamp.sec", Faults)(FAULTS) == 3
    assert field_getter("faults[1].kind", Faults)(FAULTS) == "noise"
    assert field_getter("faults[2].kind", Faults)(FAULTS) is None
    bounded = field_getter("floating_point_range[0].step", ParameterDescriptor)
    assert bounded(ParameterDescriptor()) is None
    assert field_getter("covariance[35]", PoseWithCovariance)(PoseWithCovariance()) == 0.0


@pytest.mark.parametrize(
    ("path", "kind", "reason"),
    [
        ("fault", Faults, "field 'fault': there is no 'fault'; did you mean faults?"),
        ("header.stamp.secs", Faults, "did you mean sec?"),
        ("header.stamp.sec.x", Faults, "int32 has no fields"),
        ("header[0]", Faults, "std_msgs/Header is not an array"),
        ("faults[0].knd", Faults, "did you mean kind?"),
        ("faults[]", Faults, "is not a path such as"),
        ("", Waveform, "is not a path such as"),
    ],
)
def test_a_field_that_is_not_there_is_one_line(path, kind, reason):
    with pytest.raises(ParameterError, match=r"^field '.*$") as error:
        field_getter(path, kind)
    assert reason in str(error.value)
