"""A value is allowed or refused in one line that names it, its value, its unit and its range."""

import itertools
import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.quantities import (
    Choice,
    Flag,
    ParameterError,
    Quantity,
    Text,
    did_you_mean,
    shown,
    shown_name,
)

CLOSED = Quantity("N", "force", 0.0, 10.0)
OPEN = Quantity("", "ratio", 0.0, 1.0, exclusive=True, below=True)
WHOLE = Quantity("Hz", "rate", 1.0, 1000.0, whole=True)
ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(10**5000),
    st.floats(),
    st.text(),
    st.lists(st.integers(), max_size=9),
)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1", None, [1], 1j])
def test_a_value_that_is_no_finite_number_is_refused(value):
    with pytest.raises(ParameterError, match=r"^force = .* N is outside its range \[0, 10\] N$"):
        CLOSED.check("force", value)


@pytest.mark.parametrize(
    ("quantity", "value", "complaint"),
    [
        (CLOSED, -1, "x = -1 N is outside its range [0, 10] N"),
        (CLOSED, 10.5, "x = 10.5 N is outside its range [0, 10] N"),
        (CLOSED, "2", "x = '2' N is outside its range [0, 10] N"),
        (CLOSED, 10**5000, "x = a number too long to show N is outside its range [0, 10] N"),
        (OPEN, 0, "x = 0 is outside its range (0, 1)"),
        (OPEN, 1.0, "x = 1 is outside its range (0, 1)"),
        (WHOLE, 33.3, "x = 33.3 Hz is not a whole number"),
        (WHOLE, 0, "x = 0 Hz is outside its range [1, 1000] Hz"),
    ],
    ids=itertools.count(),
)
def test_a_refusal_names_value_unit_and_range(quantity, value, complaint):
    with pytest.raises(ParameterError) as caught:
        quantity.check("x", value)
    assert str(caught.value) == complaint


@pytest.mark.parametrize(("value", "kind"), [(0, float), (10.0, float), (3, float)])
def test_a_number_becomes_a_float(value, kind):
    assert CLOSED.check("x", value) == value
    assert type(CLOSED.check("x", value)) is kind


@pytest.mark.parametrize("value", [1, 250.0, 1000])
def test_a_whole_number_becomes_an_integer(value):
    assert WHOLE.check("x", value) == value
    assert type(WHOLE.check("x", value)) is int


def test_large_whole_numbers_keep_every_digit():
    assert Quantity("", "seed", 0.0, 2.0**63, whole=True).check("seed", 2**53 + 1) == 2**53 + 1


@pytest.mark.parametrize(
    ("quantity", "text"),
    [(CLOSED, "[0, 10] N"), (OPEN, "(0, 1)"), (Quantity("m", "", 0, 1e-3, True), "(0, 0.001] m")],
)
def test_a_range_is_written_with_its_brackets_and_unit(quantity, text):
    assert quantity.range == text


def test_choices():
    choice = Choice("regime", ("free", "drilling"))
    assert choice.check("regime", "free") == "free"
    for value in ("Free", "", 3, None, ["free"]):
        with pytest.raises(ParameterError) as caught:
            choice.check("regime", value)
        assert str(caught.value) == f"regime = {value!r} is not one of free, drilling"


@pytest.mark.parametrize("value", [0, 1, "true", None, math.nan, np.bool_(True)])
def test_a_flag_is_true_or_false_and_nothing_else(value):
    assert Flag("").check("x", True) is True
    assert Flag("").check("x", False) is False
    with pytest.raises(ParameterError, match=r"^x = .* is not true or false$"):
        Flag("").check("x", value)


def test_a_text_is_a_text():
    assert Text("a file", "a path").check("x", "") == ""
    with pytest.raises(ParameterError, match=r"^x = 3 is not a text$"):
        Text("a file", "a path").check("x", 3)


@given(
    st.sampled_from([CLOSED, OPEN, WHOLE, Choice("", ("a", "b")), Flag(""), Text("", "")]), ANYTHING
)
def test_any_value_is_allowed_or_refused_in_one_short_line(allowed, value):
    try:
        checked = allowed.check("x", value)
    except ParameterError as error:
        refusal = str(error)
    else:
        assert checked == value
        assert allowed.check("x", checked) == checked
        return
    assert "\n" not in refusal
    assert len(refusal) < 200


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (10**5000, "a number too long to show"),
        ("two\nlines", r"'two\nlines'"),
        (Decimal("1.5"), "Decimal('1.5')"),
    ],
    ids=itertools.count(),
)
def test_any_value_is_shown_on_one_line(value, text):
    assert shown(value) == text
    assert len(shown("x" * 10_000)) < 100


@pytest.mark.parametrize(
    ("name", "text"),
    [("gravity", "gravity"), ("a b", "a b"), ("\x1b[31m", r"'\x1b[31m'"), (3, "3")],
)
def test_a_name_is_shown_plainly_unless_it_is_not_plain(name, text):
    assert shown_name(name) == text
    assert shown_name("x" * 61).startswith("'xxx")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("gravty", "did you mean gravity?"),
        ("zzz", "known are gravity, regime"),
        (3, "known are gravity, regime"),
    ],
)
def test_the_nearest_name_is_suggested_or_all_of_them(name, hint):
    assert did_you_mean(name, iter(["gravity", "regime"])) == hint
