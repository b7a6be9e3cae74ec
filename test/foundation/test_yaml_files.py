"""YAML from users is a value, or an error in one line with the name of its file."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.yaml_files import MOST_BYTES, cursor_at, open_yaml, parse_yaml


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
        ("", None),
    ],
)
def test_numbers_are_those_of_ros(text, value):
    assert parse_yaml(text) == value
    assert type(parse_yaml(text)) is type(value)


@pytest.mark.parametrize("word", ["off", "on", "yes", "no", "true", "False"])
def test_words_are_truth_values_or_words(word):
    assert isinstance(parse_yaml(word), bool)
    assert parse_yaml(word, truth_values=False) == word
    assert parse_yaml("1e-3", truth_values=False) == 1e-3


BROKEN = [
    ("/**: [\n", "is not YAML: while parsing"),
    ("/**:\n\tros__parameters: {}\n", "is not YAML: "),
    ("!!python/object/apply:os.system ['true']", "is not YAML: could not determine"),
    ("a: !!int ''", "is not YAML: "),
    ("a: 2001-13-45", "is not YAML: month must be in 1..12"),
    ("a: " + "[" * 20_000, "is not YAML: maximum recursion depth"),
    ("a: &a [1]\nb: [*a, *a]", "is not YAML: aliases are not allowed here"),
    ("/**: {ros__parameters: {a: 1, a: 2}}", "is not YAML: a key stands twice"),
    ("--- 1\n--- 2", "is not YAML: expected a single document"),
    ("{a: &a {x: 1}, b: [{<<: *a}]}", "is not YAML: aliases are not allowed here"),
    ("a: " + "9" * 5000, "is not YAML: Exceeds the limit"),
    ("a: !!timestamp 'x'", "is not YAML: "),
]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        *((text.encode(), complaint) for text, complaint in BROKEN),
        (b"\xff\xfe\x00\x01\xff", "is not YAML: "),
        (b"#" * (MOST_BYTES + 1), "is longer than the 100000 bytes that it may have"),
    ],
    ids=itertools.count(),
)
def test_a_file_that_cannot_be_used_is_one_line_with_its_name(tmp_path, content, complaint):
    path = tmp_path / "file.yaml"
    path.write_bytes(content)
    assert refusal(open_yaml, path).startswith(f"{path} {complaint}")


def test_a_file_may_be_as_long_as_the_limit(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_bytes(b"a: 1\n".ljust(MOST_BYTES, b"#"))
    assert open_yaml(path).value == {"a": 1}


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    missing = tmp_path / "missing.yaml"
    assert refusal(open_yaml, missing) == f"{missing}: No such file or directory"
    assert refusal(open_yaml, tmp_path) == f"{tmp_path}: Is a directory"
    assert refusal(open_yaml, "a\0b").endswith("embedded null byte")
    assert refusal(open_yaml, "/dev/zero").startswith("/dev/zero is longer than")


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


SHARE = Quantity("", "", 0.0, 1.0)
TEXT = """\
share: 2
parts:
  - {share: 3}
  - 4
"""


@pytest.mark.parametrize(
    ("read", "with_line", "with_path"),
    [
        (lambda top: top.get("share").check(SHARE), "1: share = 2 is out", " share = 2 is out"),
        (
            lambda top: top.get("parts").sequence()[0].get("share").check(SHARE),
            "3: share = 3 is outside its range [0, 1]",
            " parts[0].share = 3 is outside its range [0, 1]",
        ),
        (
            lambda top: top.get("parts").sequence()[1].mapping(),
            "4: 4 is not a mapping",
            " parts[1]: 4 is not a mapping",
        ),
        (lambda top: top.get("share").sequence(), "1: share = 2 is no", " share = 2 is no"),
        (
            lambda top: top.mapping(("parts", "shares"), unknown="{shown}: {hint}"),
            "1: 'share': did you mean shares?",
            " share: 'share': did you mean shares?",
        ),
        (lambda top: top.mapping(needed=("other",)), "1: other is missing", " other is missing"),
    ],
    ids=itertools.count(),
)
def test_an_error_names_file_and_line_or_path(tmp_path, monkeypatch, read, with_line, with_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f.yaml").write_text(TEXT)
    for lines, said in ((True, with_line), (False, with_path)):
        top = open_yaml("f.yaml", lines=lines)
        with pytest.raises(ParameterError) as caught, top.errors():
            read(top)
        assert str(caught.value).startswith(f"f.yaml:{said}")


@pytest.mark.parametrize("text", ["", "# nothing\n"])
def test_a_file_without_a_value_fails_in_its_first_line(tmp_path, text):
    (tmp_path / "f.yaml").write_text(text)
    with pytest.raises(ParameterError, match=r"f\.yaml:1: None is not a mapping$"):
        open_yaml(tmp_path / "f.yaml").mapping()


def test_errors_of_other_code_get_the_place_once():
    entry = cursor_at([1], "--inject").sequence()[0]
    with (
        pytest.raises(ParameterError, match=r"^--inject: \[0\]: text$"),
        entry.errors(),
        entry.errors(),
    ):
        raise ParameterError("text")
