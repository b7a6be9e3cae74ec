"""YAML from users is a value, or an error in one line with the name of its file."""

import dataclasses
import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.foundation.quantities import Choice, Flag, ParameterError, Quantity
from rpud_sim.foundation.schema import key, line, list_of, name_in, named, one_of, read
from rpud_sim.foundation.yaml_files import MOST_BYTES, open_yaml, parse_yaml, yaml_node


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1.96e11", 1.96e11),
        ("-2E5", -2e5),
        ("+.5e-1", 0.05),
        ("3", 3),
        ("'1e-3'", "1e-3"),
        ("1e", "1e"),
        ("e5", "e5"),
        ("{a: [1, 2.5, true]}", {"a": [1, 2.5, True]}),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("1:30.5", "1:30.5"),
        ("0x1f", 31),
        ("010", 8),
        ("08", 8.0),
        ("-.inf", -math.inf),
        ("False", False),
        ("off", "off"),  # a kind of fault
        ("", None),
    ],
)
def test_numbers_are_those_of_ros_and_truth_values_those_of_yaml_1_2(text, value):
    assert parse_yaml(text) == value
    assert type(parse_yaml(text)) is type(value)


BROKEN = [
    ("/**: [\n", "is not YAML: line 2: "),
    ("/**:\n\tros__parameters: {}\n", "is not YAML: "),
    ("!!python/object/apply:os.system ['true']", "is not YAML: line 1: the tag 'tag:yaml.org"),
    ("a: !foo b", "is not YAML: line 1: the tag '!foo' means nothing here"),
    ("[1, 2]: 3", "is not YAML: line 1: a key is a list or a mapping"),
    ("a: \x07", "is not YAML: unacceptable character #x0007: special characters are not allowed"),
    ("a: !!int 'x'", "is not YAML: 'x' is not a number"),
    ("a: 2001-13-45", "is not YAML: month must be in 1..12"),
    ("a: " + "[" * 20_000, "is not YAML: it is nested too deep"),
    ("a: " + "[" * 60 + "]" * 60, "is not YAML: nested deeper than 50 levels"),
    ("a: &a [1]\nb: [*a, *a]", "is not YAML: line 2: aliases are not allowed here"),
    ("/**: {ros__parameters: {a: 1, a: 2}}", "is not YAML: line 1: a key occurs twice"),
    ("--- 1\n--- 2", "is not YAML: line 2: expected a single document in the stream, "),
    ("a: " + "9" * 5000, "is not YAML: a number has too many digits"),
    ("a: !!timestamp 'x'", "is not YAML: "),
]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        *((text.encode(), complaint) for text, complaint in BROKEN),
        (b"\xff\xfe\x00\x01\xff", "is not YAML: line 1: the byte 0xff is not UTF-8"),
        (b"a: 1\nb: '\xb0'\n", "is not YAML: line 2: the byte 0xb0 is not UTF-8"),
        (b"#" * (MOST_BYTES + 1), "is longer than the 100000 bytes that it may have"),
    ],
    ids=itertools.count(),
)
def test_a_file_that_cannot_be_used_is_one_line_with_its_name(tmp_path, content, complaint):
    path = tmp_path / "file.yaml"
    path.write_bytes(content)
    assert refusal(open_yaml, path).startswith(f"{path} {complaint}")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    missing = tmp_path / "missing.yaml"
    assert refusal(open_yaml, missing) == f"{missing}: No such file or directory"
    assert refusal(open_yaml, tmp_path) == f"{tmp_path}: Is a directory"
    assert refusal(open_yaml, "a\0b").endswith("embedded null byte")
    assert refusal(open_yaml, "/dev/zero").endswith("/dev/zero: is not a regular file")


TAGS = ["int", "float", "bool", "timestamp", "binary", "null", "set", "omap", "pairs", "str"]


@given(
    text=st.one_of(
        st.text(),
        st.binary(),
        st.builds("a: [!!{} {!r}]".format, st.sampled_from(TAGS), st.text(max_size=8)),
        st.text(alphabet="{}[]:,-&*!?|>'\"%@#~ \n\tkfo01._<=/", max_size=60),
    )
)
def test_any_file_is_a_value_or_refused_in_one_line(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "fuzzed.yaml"
    path.write_bytes(
        text if isinstance(text, bytes) else text.encode("utf-8", errors="surrogatepass")
    )
    found = refusal(open_yaml, path)
    assert not found or found.startswith(str(path))


@dataclasses.dataclass(frozen=True)
class Part:
    share: float = key(Quantity("", "", 0.0, 1.0))
    kind: str = key(Choice("", ("hard", "soft")), "hard", name="is")
    open: bool = key(Flag(""), False)

    def __post_init__(self):
        if self.open and self.kind == "soft":
            raise ParameterError("open is for what is hard")


READERS = {
    "parts": list_of(Part, 1, 2, unique=True),
    "rocks": named(name_in(("sandstone", "basalt"), "a rock")),
    "feed": one_of({"rate": Quantity("m/s", "", 0.0, 1.0), "position": line}),
}


def test_a_reader_returns_what_the_declarations_say():
    content = {
        "parts": [{"share": 1}, {"share": 0.5, "is": "soft", "open": "off"}],
        "rocks": {"first one": "basalt"},
        "feed": {"rate": 1},
    }
    assert read(yaml_node(content, "f"), READERS) == {
        "parts": (Part(1.0), Part(0.5, "soft")),
        "rocks": {"first one": "basalt"},
        "feed": ("rate", 1.0),
    }


@pytest.mark.parametrize(
    ("text", "with_line", "with_path"),
    [
        ("", "1: the file is not a mapping of", " the file is not a mapping of"),
        ("\npart: 1", "2: 'part' is not a key here; did you", " 'part' is not a key here; did you"),
        ("parts: 2", "1: parts = 2 is not a list", " parts = 2 is not a list"),
        (
            "parts: []",
            "1: parts = [] has 0 entries, not 1 to 2",
            " parts = [] has 0 entries, not 1",
        ),
        ("parts:\n- 4", "2: parts[0] = 4 is not a mapping", " parts[0] = 4 is not a mapping"),
        ("parts:\n- {is: soft}", "2: share is missing", " parts[0]: share is missing"),
        (
            "parts:\n- is: hard\n  share: 3",
            "3: share = 3 is outside its range [0, 1]",
            " parts[0].share = 3 is outside its range [0, 1]",
        ),
        (
            "parts:\n- share: 1\n  is: soft\n  open: yes",
            "4: open is for what is hard",  # the line of the key that is named
            " parts[0]: open is for what is hard",
        ),
        ("parts: [{share: 1}, {share: 1.0}]", "1: parts = [", " parts = ["),
        (
            "rocks: {a: basal}",
            "1: a = 'basal' is not a rock; did you mean basalt?",
            " rocks.a = 'basal' is not a rock; did you mean basalt?",
        ),
        ('rocks: {"a\\nb": basalt}', "1: ", " rocks.'a\\nb' = 'basalt' is not a text of one line"),
        (
            "feed: {rate: 1, position: a}",
            "1: feed = {'position': 'a', 'rate': 1} is not a mapping with one of rate, position",
            " feed = {'position': 'a', 'rate': 1} is not a mapping with one of rate, position",
        ),
    ],
    ids=itertools.count(),
)
def test_an_error_names_file_and_line_or_path(tmp_path, monkeypatch, text, with_line, with_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.yaml").write_text(text)
    top = open_yaml("f.yaml")
    for node, said in ((top, with_line), (yaml_node(top.value, "f.yaml"), with_path)):
        assert refusal(read, node, READERS).startswith(f"f.yaml:{said}")


def test_errors_of_other_code_get_the_place_once():
    entry = yaml_node([1], "--inject").sequence()[0]
    with (
        pytest.raises(ParameterError, match=r"^--inject: \[0\]: text$"),
        entry.errors(),
        entry.errors(),
    ):
        raise ParameterError("text")
