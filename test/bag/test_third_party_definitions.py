"""Definitions as other tools store them are understood, or the reason says why not, in words."""

import struct

import pytest
from raw_mcap import RawMcap

import rpud_sim.bag

X = b"\0\1\0\0" + struct.pack("<d", 1.5)
SEPARATOR = "=" * 80


def file_of(path, text, *, kind="pkg/msg/A", encoding="ros2msg", data=X):
    definition = text.encode() if isinstance(text, str) else text
    raw = RawMcap([("/a", 5, data)], type=kind, encoding=encoding, definition=definition)
    path.write_bytes(raw.content())
    return path


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("float64 x # [N]\r\n\r\n# end\r\n", "pkg/msg/A"),
        ("float64 x # [N]\r", "pkg/msg/A"),
        ("\ufefffloat64 x # [N]\n", "pkg/msg/A"),
        ("\tfloat64\tx\t# [N]\n", "pkg/msg/A"),
        ("float64 x # [N]", "pkg/A"),
        ("float64 x 2.5 # [N]\nuint8 B=1", "pkg/msg/A"),
        ("uint8 A=0b11\nuint8 B=0o17\nint64 C=1_000\nfloat64 x # [N]", "pkg/msg/A"),
        ("string S='it''s'\nstring EMPTY=\nstring T=a = b # c\nfloat64 x # [N]", "pkg/msg/A"),
        ("wstring W='a'\nfloat64 N=nan\nint8 x=1\nfloat64 x # [N]", "pkg/msg/A"),
        ("\x0cfloat64 x # [N]\x0b", "pkg/msg/A"),
    ],
)
def test_a_field_is_decoded_with_its_unit(tmp_path, text, kind):
    with rpud_sim.bag.open(file_of(tmp_path / "a.mcap", text, kind=kind)) as bag:
        assert bag.topics[0].topic.type == "pkg/msg/A"
        assert bag.arrays("/a")["x"].tolist() == [1.5]
        [unit] = [each.unit for each in bag.columns("/a") if each.name == "x"]
        assert unit == "N"


@pytest.mark.parametrize("name", ["pkg/B", "pkg/msg/B"])
@pytest.mark.parametrize("end", ["\n", "\r\n", " \r\n"])
def test_types_in_a_definition_are_found(tmp_path, name, end):
    lines = ["pkg/B b", "", SEPARATOR, f"MSG: {name}", "float64 x # [N]", ""]
    path = file_of(tmp_path / "a.mcap", end.join(lines))
    with rpud_sim.bag.open(path) as bag:
        assert bag.arrays("/a")["b.x"].tolist() == [1.5]
        assert [each.unit for each in bag.columns("/a")][-1] == "N"


@pytest.mark.parametrize("line", ["=" * 79, "=" * 81, "===", f"  {SEPARATOR} ", f"{SEPARATOR}\n"])
@pytest.mark.parametrize("name", ["MSG: pkg/B # c", "MSG:pkg/B", "MSG: pkg/B\n\ufeff"])
def test_other_tools_part_a_definition_otherwise(tmp_path, line, name):
    path = file_of(tmp_path / "a.mcap", f"B b\n{line}\n{name}\nfloat64 x # [N]")
    with rpud_sim.bag.open(path) as bag:
        assert bag.arrays("/a")["b.x"].tolist() == [1.5]
        assert [each.unit for each in bag.columns("/a")][-1] == "N"


def test_the_times_of_ros_need_no_definition(tmp_path):
    text = "builtin_interfaces/Time t\nbuiltin_interfaces/Duration d\nstring s 'a'\nstring u b"
    data = b"\0\1\0\0" + struct.pack("<iIiIII", 4, 5, -1, 7, 0, 0)  # texts without their end
    with rpud_sim.bag.open(file_of(tmp_path / "a.mcap", text, data=data)) as bag:
        found = {name: each.tolist() for name, each in bag.arrays("/a").items()}
    assert (found["t"], found["d"]) == ([4_000_000_005], [-999_999_993])
    assert found["s"] == found["u"] == [""]


def test_a_line_ends_where_it_does_for_ros(tmp_path):
    text = "int32 a # a comment\u2028int32 b"
    data = b"\0\1\0\0" + struct.pack("<ii", 1, 2)
    with rpud_sim.bag.open(file_of(tmp_path / "a.mcap", text, data=data)) as bag:
        assert bag.arrays("/a")["b"].tolist() == [2]


@pytest.mark.parametrize(
    ("text", "encoding", "reason"),
    [
        ("module pkg {};", "ros2idl", "the definition of its type is IDL; only ros2msg"),
        ("{}", "jsonschema", "the definition of its type is 'jsonschema'; only ros2msg"),
        (b"float64 x # [\xb0]", "ros2msg", "the definition of its type is not UTF-8: .* 0xb0"),
        ("", "", "the bag does not hold the definition of its type"),
        ("wstring x", "ros2msg", "cannot be understood: it has a wstring, which releases of ROS"),
        (f"B b\n{SEPARATOR}\nMSG: pkg/B\nwstring<=5[] x", "ros2msg", "it has a wstring"),
        (f"B b\n{SEPARATOR}\nIDL: pkg/msg/B\nmodule", "ros2msg", "a part of it is IDL"),
        ("other/C c", "ros2msg", "cannot be understood: it lacks the type other/msg/C"),
        ("float64 x\n# a\n1 two", "ros2msg", "line 3 of pkg/msg/A is not a field: 1 two"),
        ("A[] x", "ros2msg", "it is nested too deep, or contains itself"),
        ("", "unknown", "the bag does not hold the definition of its type"),
        ("@optional\nfloat64 x", "ros2msg", "line 1 of pkg/msg/A is not a field: @optional"),
        ("float64\u00a0x", "ros2msg", "line 1 of pkg/msg/A is not a field: float64"),
    ],
)
def test_what_is_not_understood_has_its_reason_in_words(tmp_path, text, encoding, reason):
    path = file_of(tmp_path / "a.mcap", text, encoding=encoding)
    with (
        rpud_sim.bag.open(path) as bag,
        pytest.raises(rpud_sim.bag.BagFormatError, match=reason) as caught,
    ):
        bag.arrays("/a")
    assert "Error" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"\x28\xb5\x2f\xfd" + X, "it is a frame of zstd, not plain CDR"),
        (b"\0\7" + X[2:], "it is XCDR2, not plain CDR"),
        (b"\0\3" + X[2:], "its encapsulation is not plain CDR"),
        (b"", "it has 0 bytes, and is not plain CDR"),
        (X[:8], "it ends too early"),
    ],
)
def test_a_message_that_is_no_cdr_has_its_reason_in_words(tmp_path, data, reason):
    path = file_of(tmp_path / "a.mcap", "float64 x", data=data)
    with (
        rpud_sim.bag.open(path) as bag,
        pytest.raises(rpud_sim.bag.BagFormatError, match=f"cannot be understood: {reason}"),
    ):
        bag.arrays("/a")


@pytest.mark.parametrize("kind", ["", "a b/../c", "B", "x/y/z/Q"])
def test_a_type_without_a_proper_name_is_named(tmp_path, kind):
    with (
        rpud_sim.bag.open(file_of(tmp_path / "a.mcap", "float64 x", kind=kind)) as bag,
        pytest.raises(
            rpud_sim.bag.BagFormatError, match=f"understood: '{kind}' is not a type name"
        ),
    ):
        bag.arrays("/a")


def test_definitions_that_differ_in_form_alone_are_one(tmp_path):
    texts = (
        f"B b # one\nC[<=3] c 5\n{SEPARATOR}\nMSG: pkg/B\nfloat64 x\n{SEPARATOR}\nMSG: pkg/C\n"
        "int8 y",
        f"uint8 K=1\npkg/msg/B b\npkg/C[<=3] c\r\n{SEPARATOR}\nMSG: pkg/msg/C\nint8 y # two\n"
        f"{SEPARATOR}\nMSG: pkg/B\nfloat64 x",
    )
    for number, text in enumerate(texts):
        file_of(tmp_path / f"run_{number}.mcap", text, data=X + bytes(4))
    with rpud_sim.bag.open(tmp_path) as bag:
        assert bag.arrays("/a")["b.x"].tolist() == [1.5, 1.5]
    file_of(tmp_path / "run_2.mcap", texts[0].replace("int8 y", "int16 y"), data=X + bytes(4))
    with (
        rpud_sim.bag.open(tmp_path) as bag,
        pytest.raises(rpud_sim.bag.BagFormatError, match="several types or definitions"),
    ):
        bag.arrays("/a")
