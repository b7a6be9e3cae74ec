"""Definitions are complete, ordered and without repetition, as ``ros2msg`` requires."""

import pytest

from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.messages.errors import BagError


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    def add(name, text):
        package, message = name.split("/")
        file = tmp_path / "share" / package / "msg" / f"{message}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    add(
        "a_msgs/Outer",
        "# a Comment of Words\n"
        'string NAME = "b_msgs/Leaf"\n'
        "Inner[] inner\n"
        "  b_msgs/Leaf[<=3] leaves\n"
        "string<=10[<=5] words\n"
        "float64[4] numbers\n"
        "wstring wide\n"
        "c_msgs/msg/Long long\n",
    )
    add("a_msgs/Inner", "b_msgs/Leaf leaf\nInner2 next\n")
    add("a_msgs/Inner2", "int8 x\n")
    add("b_msgs/Leaf", "int8 LEAF=1\nuint8 y")
    add("c_msgs/Long", "bool z\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    return tmp_path


def test_dependencies_follow_in_order_once_each(prefix):
    text = find_definition("a_msgs/msg/Outer")
    parts = text.split("\n" + "=" * 80 + "\n")
    heads = [part.partition("\n")[0] for part in parts[1:]]
    assert heads == [
        "MSG: a_msgs/Inner",
        "MSG: b_msgs/Leaf",
        "MSG: c_msgs/Long",
        "MSG: a_msgs/Inner2",
    ]
    assert parts[0].startswith("# a Comment")
    assert parts[2] == "MSG: b_msgs/Leaf\nint8 LEAF=1\nuint8 y"


@pytest.mark.parametrize("name", ["b_msgs/Leaf", "std_msgs/Header"])
def test_earlier_prefixes_win_and_those_of_the_package_are_last(prefix, monkeypatch, name):
    package, message = name.split("/")
    file = prefix / "overlay" / "share" / package / "msg" / f"{message}.msg"
    file.parent.mkdir(parents=True)
    file.write_text("int16 other\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix / 'overlay'}:{prefix}")
    assert find_definition(f"{package}/msg/{message}") == "int16 other\n"


@pytest.mark.parametrize("name", ["a_msgs/msg/Missing", "Outer", "a/b/c/d", "../a/Outer", ""])
def test_an_unknown_type_is_named(prefix, name):
    with pytest.raises(BagError, match=name or "''"):
        find_definition(name)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"type_hashes": []}'])
def test_a_description_without_the_hash_is_refused(prefix, text):
    (prefix / "share" / "a_msgs" / "msg" / "Outer.json").write_text(text)
    with pytest.raises(BagError, match="a_msgs/msg/Outer"):
        find_type_hash("a_msgs/msg/Outer")


OWN = (
    "builtin_interfaces/msg/Time",
    "geometry_msgs/msg/WrenchStamped",
    "rpud_msgs/msg/ContactForce",
    "rpud_msgs/msg/Status",
    "rpud_msgs/msg/Trajectory",
    "sensor_msgs/msg/JointState",
    "std_msgs/msg/Header",
)


@pytest.mark.parametrize("name", OWN)
def test_without_ros_fields_and_hash_are_the_same(name, monkeypatch):
    def fields(definition):
        lines = (line.partition("#")[0].split() for line in definition.splitlines())
        return [line for line in lines if line]

    installed = fields(find_definition(name)), find_type_hash(name)
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    assert (fields(find_definition(name)), find_type_hash(name)) == installed
