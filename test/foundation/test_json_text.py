"""JSON has no number that is NaN or infinite, and an error names the first one."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.json_text import finite_values, json_text, name_of
from rpud_sim.foundation.quantities import ExpectedError
from rpud_sim.foundation.values import to_float32

NUMBERS = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
PLAIN = st.recursive(NUMBERS, lambda each: st.lists(each) | st.dictionaries(st.text(), each))


@given(PLAIN)
def test_text_that_every_reader_takes_or_an_error(value):
    finite = finite_values(value)
    text = json_text(finite)
    assert json.loads(text, parse_constant=pytest.fail) == finite
    if finite == value:
        assert json_text(value) == text
    else:
        with pytest.raises(ExpectedError, match="is not a finite number"):
            json_text(value)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"a": 1.0, "b": {"depth": math.nan}, "c": math.inf}, "b.depth = nan"),
        ({"a": [1.0, {"b": -math.inf}]}, r"a\[1\].b = -inf"),
        (math.inf, "the result = inf"),
    ],
)
def test_the_error_names_the_number(value, message):
    with pytest.raises(ExpectedError, match=f"^{message} is not a finite number$") as error:
        json_text(value)
    assert error.value.code == 1


def test_what_json_lacks_becomes_null_or_a_text():
    value = {"a": [math.nan, 1.0], "b": (math.inf, -math.inf)}
    assert finite_values(value) == {"a": [None, 1.0], "b": [None, None]}
    named = {"a": ["NaN", 1.0], "b": ["Infinity", "-Infinity"]}
    assert finite_values(value, name_of) == named


def test_a_number_beyond_32_bits_is_infinite_without_a_warning():
    assert to_float32([1.5, 1e300, -1e300, math.nan]).tolist()[:3] == [1.5, math.inf, -math.inf]
