"""Columns of many messages at once: the same as those of each message decoded by itself."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sample_bags import SEPARATOR, batch_of, serialized
from support import examples

from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import FieldReader, Kind, columns_of, to_plain
from rpud_sim.messages.encoder import Decoded

PARTS = f"""
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{SEPARATOR}
MSG: pkg/Item
float64 x
float64 turn
"""
RANGES = {
    "bool": st.booleans(),
    "byte": st.integers(0, 127),  # the library has a sign
    "char": st.integers(0, 255),
    **{f"int{bits}": st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32)},
    **{f"uint{bits}": st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "int64": st.integers(-(2**63), 2**63 - 1),
    "float32": st.floats(width=32),
    "float64": st.floats(),
}
FORMS = ["one", "text", "texts", "two texts", "array", "many", "time", "items", "part"]
DTYPES = {"bool": np.bool_, "byte": np.int8, "char": np.uint8}


def numbers(kind, count):
    parts = st.lists(RANGES[kind], min_size=count or 0, max_size=count or 4)
    return parts.map(lambda values: np.array(values, DTYPES.get(kind) or np.dtype(kind)))


@st.composite
def types(draw):
    """The text of a type, and its values."""
    lines, values = [], {}
    parts = draw(st.lists(st.sampled_from(FORMS)))
    part_lines, part_values = [], {}
    for number, form in enumerate([*parts, "one"]):
        kind, name = draw(st.sampled_from([*RANGES])), f"f{number}"
        inner = draw(st.booleans())
        count = draw(st.integers(1, 3))
        text, value = {
            "one": (kind, RANGES[kind]),
            "text": ("string", st.text("ab ß", max_size=4)),
            "texts": ("string[]", st.lists(st.text("ab ß", max_size=4), max_size=3)),
            "two texts": ("string[2]", st.lists(st.text("aß"), min_size=2, max_size=2)),
            "array": (f"{kind}[{count}]", numbers(kind, count)),
            "many": (f"{kind}[]", numbers(kind, 0)),
            "time": (
                "builtin_interfaces/Time",
                st.fixed_dictionaries({"sec": RANGES["int32"], "nanosec": RANGES["uint32"]}),
            ),
            "items": ("pkg/Item[]", st.lists(st.just({"x": 1.0, "turn": 2.0}), max_size=3)),
            "part": (kind, RANGES[kind]),
        }[form]
        (part_lines if inner else lines).append(f"{text} {name}")
        (part_values if inner else values)[name] = value
    definition = "\n".join([*lines, "pkg/Part part" if part_lines else "bool none"])
    if part_lines:
        values["part"] = st.fixed_dictionaries(part_values)
        definition += "\n".join(["", SEPARATOR, "MSG: pkg/Part", *part_lines])
    else:
        values["none"] = st.booleans()
    return definition + PARTS, st.fixed_dictionaries(values)


def write(definition, fields, order):
    """Serialize as `serialized` does, or with the other order of bytes."""
    if order == "<":
        return serialized("pkg/msg/All", definition, fields)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, "pkg/msg/All"))
    little = serialized("pkg/msg/All", definition, fields)
    message = store.deserialize_cdr(little, "pkg/msg/All")
    return bytes(store.serialize_cdr(message, "pkg/msg/All", little_endian=False))


def told(value):
    """Plain values as text, in which NaN is itself."""
    if isinstance(value, Sequences):
        return repr([part.tolist() for part in value.rows()])
    return repr(to_plain(value))


def of_library(value):
    """A value of the other library as one of ours."""
    if hasattr(value, "__msgtype__"):
        fields = {name: of_library(each) for name, each in vars(value).items() if name[0] != "_"}
        return Decoded(value.__msgtype__, fields)
    return [of_library(each) for each in value] if isinstance(value, list) else value


def assert_same(codec, columns, messages, gap=b""):
    """Check that messages give together what each gives by itself."""
    reader = FieldReader(codec, columns)
    found = reader.read(batch_of(messages, gap=gap))
    single = [reader.read(batch_of([message])) for message in messages]
    errors = [(n, text) for n, each in enumerate(single) for _, text in each.errors]
    assert [*found.errors] == errors
    assert found.rows.tolist() == [n for n, each in enumerate(single) if len(each.rows)]
    for column in columns:
        values = found.columns[column.name]
        rows = values.rows() if isinstance(values, Sequences) else [*values]
        expected = [each.columns[column.name] for each in single if len(each.rows)]
        expected = [each.rows() if isinstance(each, Sequences) else each for each in expected]
        assert [*map(told, rows)] == [told(each) for (each,) in expected], column.name


@settings(max_examples=examples(40))
@given(types(), st.data(), st.sampled_from("<>"))
def test_values_are_those_of_another_library(kind, data, order):
    definition, values = kind
    message = write(definition, data.draw(values), order)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, "pkg/msg/All"))
    codec = Codec("pkg/msg/All", definition)
    fields = store.deserialize_cdr(message, "pkg/msg/All")
    found = codec.decode(message)
    for name, _ in codec.members.members:
        assert told(getattr(found, name)) == told(of_library(getattr(fields, name)))


@settings(max_examples=examples(40))
@given(types(), st.data())
def test_many_messages_have_the_values_of_each(kind, data):
    definition, values = kind
    many = data.draw(st.lists(values, min_size=1, max_size=5))
    order = data.draw(st.sampled_from("<<>"))
    messages = 8 * [write(definition, fields, order) for fields in many]
    if data.draw(st.booleans()):
        messages += [write(definition, fields, "<") for fields in many]
    codec = Codec("pkg/msg/All", definition)
    columns = columns_of(codec, definition)
    assert_same(codec, columns, messages, data.draw(st.binary(max_size=9)))
    # Lists of messages that nobody asks for do not part the others.
    assert_same(codec, [each for each in columns if each.kind is not Kind.NESTED], messages)


@settings(max_examples=examples(40))
@given(types(), st.data())
def test_what_is_no_message_gives_the_same_error(kind, data):
    definition, values = kind
    whole = [
        write(definition, fields, "<")
        for fields in data.draw(st.lists(values, min_size=2, max_size=3))
    ]
    changed = []
    for message in whole:
        content = bytearray(message)
        for _ in range(data.draw(st.integers(0, 2))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
        cut = data.draw(st.integers(0, len(content)))
        changed += [
            bytes(content),
            bytes(content[:cut]),
            message + data.draw(st.binary(max_size=9)),
        ]
    others = data.draw(st.lists(st.binary(max_size=20), max_size=3))
    codec = Codec("pkg/msg/All", definition)
    columns = columns_of(codec, definition)
    assert_same(codec, columns, [*whole, *others, *changed] * 8)
    assert_same(codec, columns, [*others, *changed, *whole * 8])
