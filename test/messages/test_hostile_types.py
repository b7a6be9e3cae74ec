"""Hostile types and messages end in one clear line, in bounded memory."""

import struct

import pytest
from sample_bags import START, write_mcap

import rpud_sim.bag
from rpud_sim.bag import BagFormatError
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import columns_of

GIGABYTE = 2**30
SEPARATOR = "=" * 80


@pytest.mark.parametrize(
    "definition",
    [
        "A x\n",
        "string[4294967295] x\n",
        "string[100] x\n" * 200,
        f"B[4294967295] x\n{SEPARATOR}\nMSG: a_msgs/B\nint8 x\n",
        "\x00\x01 x\n",
    ],
    ids=lambda text: text[:20],
)
def test_a_wrong_schema_is_one_line(definition):
    with pytest.raises(BagFormatError) as caught:
        Codec("a_msgs/msg/A", definition)
    assert len(str(caught.value)) < 500
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("definition", "data"),
    [
        ("float64 x\n", b"\0\1\0\0"),
        ("float64[] x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("string x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("string[] x\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        (f"B[] x\n{SEPARATOR}\nMSG: a_msgs/B\nint8 X=1\n", b"\0\1\0\0\xff\xff\xff\x7f"),
        ("float64[99999999999999999999] x\n", b"\0\1\0\0"),
        ("string x\n", b"\0\1\0\0\2\0\0\0\xff\0"),
    ],
)
def test_a_message_that_is_not_of_its_type_is_one_line(definition, data):
    with pytest.raises(BagFormatError, match="a message of a_msgs/msg/A cannot be understood"):
        Codec("a_msgs/msg/A", definition).decode(data)


def nest(depth, leaf):
    """Return the definition of a type in which each member has two of the next."""
    parts = ["N1 first\nN1 second\n"]
    for level in range(1, depth):
        fields = leaf if level == depth - 1 else f"N{level + 1} first\nN{level + 1} second\n"
        parts.append(f"{SEPARATOR}\nMSG: a_msgs/N{level}\n{fields}")
    return "".join(parts)


ARRAYS = "".join(f"{SEPARATOR}\nMSG: a_msgs/N{n}\nN{n + 1}[99] next\n" for n in (1, 2))


@pytest.mark.parametrize(
    "definition",
    [
        *(nest(31, leaf) for leaf in ("int8 X=1\n", "int8 x\n", "int8[] x\n")),
        f"N1[99] next\n{ARRAYS}{SEPARATOR}\nMSG: a_msgs/N3\nint8 x\n",
    ],
    ids=range(4),
)
def test_a_type_of_countless_members_is_refused_unvisited(definition):
    with pytest.raises(BagFormatError, match="fields, including its members'; at most 100000"):
        Codec("a_msgs/msg/N0", definition)


@pytest.mark.parametrize("fields", ["int32 sec\n", "float64 sec\nuint32 nanosec\n", "int8 x\n"])
def test_a_time_of_other_fields_is_no_time(fields):
    definition = f"builtin_interfaces/Time t\n{SEPARATOR}\nMSG: builtin_interfaces/Time\n{fields}"
    columns = columns_of(Codec("a_msgs/msg/A", definition), definition)
    assert [each.name for each in columns] == [
        f"t.{line.split()[1]}" for line in fields.splitlines()
    ]


TINY = f"B[] parts\n{SEPARATOR}\nMSG: a_msgs/B\nint8 x\n"
GREEDY = {  # a definition, and the first bytes of a message that ends in zeros
    "tiny members": (TINY, struct.pack("<I", 60_000_000)),
    "texts": ("string[] texts\n", struct.pack("<I", 12_000_000) + struct.pack("<IB3x", 1, 0) * 9),
    "members' members": (
        f"C[] more\n{SEPARATOR}\nMSG: a_msgs/C\n{TINY}",
        struct.pack("<II", 1, 60_000_000),
    ),
    "numbers": ("uint8[] numbers\n", struct.pack("<I", 60_000_000)),
    "text": ("string text\n", struct.pack("<I", 60_000_000)),
}


def greedy_bag(path, definition, head, size):
    """Write a bag of a few kB with one message of ``size`` bytes and return its path."""
    message = b"\0\1\0\0" + head
    message += bytes(size - len(message))
    options = {"kind": "a_msgs/msg/A", "definitions": {"/a": definition}}
    return write_mcap(path, [("/a", START, message)], **options)


@pytest.mark.extended
@pytest.mark.parametrize("name", GREEDY)
def test_a_message_that_grows_when_it_is_decoded_is_refused(tmp_path, name):
    path = greedy_bag(tmp_path / "run.mcap", *GREEDY[name], 64_000_000)
    assert path.stat().st_size < 20_000
    with (
        rpud_sim.bag.open(path) as bag,
        pytest.raises(BagFormatError, match="at most 268435456 are read"),
    ):
        bag.arrays("/a")
