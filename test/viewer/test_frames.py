"""What travels to the browser comes back as it was."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from viewer.frame_reader import decode

from rpud_sim.viewer.session import encode

times = arrays(np.float64, st.integers(0, 20), elements=st.floats(allow_nan=False))
values = arrays(np.float32, st.integers(0, 20), elements=st.floats(width=32, allow_nan=False))


@given(first=times, second=values, text=st.text(st.characters(min_codepoint=32, max_codepoint=126)))
def test_numbers_arrays_and_texts_come_back(first, second, text):
    found = decode(encode({"a": {"t": first, "v": [second]}, "n": 1, "text": text}))
    assert (found["n"], found["text"]) == (1, text)
    np.testing.assert_array_equal(found["a"]["t"], first)
    np.testing.assert_array_equal(found["a"]["v"][0], second)
    assert (found["a"]["t"].dtype, found["a"]["v"][0].dtype) == (np.float64, np.float32)


def test_arrays_begin_where_a_browser_can_view_them():
    data = encode({"text": "x", "a": np.zeros(3, np.float32), "b": np.ones(2)})
    begin = 4 + int.from_bytes(data[:4], "little")
    assert (len(data) - (begin + -begin % 8)) % 8 == 0


def test_numbers_that_json_has_no_form_for_are_null():
    found = decode(encode({"a": math.nan, "b": [math.inf, np.float64(-math.inf), np.int32(3)]}))
    assert found == {"a": None, "b": [None, None, 3]}


def test_control_characters_of_a_stranger_are_shown_and_not_sent():
    assert "\x1b" not in decode(encode({"kind": "a\x1b[31m"}))["kind"]
