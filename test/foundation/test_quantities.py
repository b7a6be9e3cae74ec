"""A value is allowed or refused in one line that names it, its value, its unit and its range."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.foundation.quantities import (
    Choice,
    Declaration,
    Flag,
    ParameterError,
    ParameterGroup,
    Quantity,
    Text,
    choice,
    declarations,
    did_you_mean,
    flag,
    number,
    quantities,
    short_name,
    short_repr,
    text,
)
from rpud_sim.foundation.time import SECOND, join_seconds, split_fraction, split_seconds

CLOSED = Quantity("N", "force", 0.0, 10.0)
OPEN = Quantity("", "ratio", 0.0, 1.0, exclusive=True, below=True)
WHOLE = Quantity("Hz", "rate", 1.0, 1000.0, whole=True)
CHOICE, FLAG, TEXT = Choice("regime", ("free", "drilling")), Flag(""), Text("a file", "a path")
OUTSIDE = "is outside its range [0, 10] N"
NO_NUMBER = "is not a number; its range is [0, 10] N"


@pytest.mark.parametrize(
    ("allowed", "value", "complaint"),
    [
        *((CLOSED, each, f"= {each:g} N {OUTSIDE}") for each in (-1.0, 10.5, math.nan, math.inf)),
        *((CLOSED, each, f"= {each!r} {NO_NUMBER}") for each in (True, "2", None, [1], 1j)),
        (CLOSED, 10**5000, f"= a number too long to show N {OUTSIDE}"),
        (OPEN, 0, "= 0 is outside its range (0, 1)"),
        (OPEN, 1.0, "= 1 is outside its range (0, 1)"),
        (WHOLE, 33.3, "= 33.3 Hz is not a whole number"),
        (WHOLE, 0, "= 0 Hz is outside its range [1, 1000] Hz"),
        (Quantity("m", "", 0, 1e-3, True), 0, "= 0 m is outside its range (0, 0.001] m"),
        *((CHOICE, each, f"= {each!r} is not one of free, drilling") for each in ("Free", 3, [])),
        *((FLAG, each, f"= {each!r} is not true or false") for each in (1, "true", np.bool_(1))),
        (TEXT, 3, "= 3 is not a text"),
    ],
    ids=itertools.count(),
)
def test_a_refusal_names_value_unit_and_range(allowed, value, complaint):
    assert refusal(allowed.check, "x", value) == f"x {complaint}"


def test_a_long_text_is_refused_and_a_long_name_not_searched():
    with pytest.raises(ParameterError, match="x has 4097 characters; allowed are 4096 at most"):
        Text("", "").check("x", 4097 * "a")
    assert Text("", "").check("x", 4096 * "a")
    assert did_you_mean("regim", ["regime"]) == "; did you mean regime?"
    assert did_you_mean("/lefd", ["/left", "/right"]) == "; did you mean /left?"
    assert did_you_mean("/rpud/mount", ["/rpud/wrench"], others=False) == ""  # they begin alike
    assert did_you_mean("wrnech", ["/rpud/wrench"]) == "; did you mean /rpud/wrench?"
    assert did_you_mean(10_000_000 * "regim", ["regime"]) == "; valid ones are regime"  # in no time


@pytest.mark.parametrize(
    ("allowed", "value", "kind"),
    [(CLOSED, 0, float), (CLOSED, 10.0, float), (WHOLE, 250.0, int), (WHOLE, 1, int)],
)
def test_a_number_is_kept_in_its_type(allowed, value, kind):
    assert allowed.check("x", value) == value
    assert type(allowed.check("x", value)) is kind
    # Large whole numbers keep every digit.
    assert Quantity("", "", 0.0, 2.0**63, whole=True).check("seed", 2**53 + 1) == 2**53 + 1


ANYTHING = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.lists(st.integers())
)


@given(st.sampled_from([CLOSED, OPEN, WHOLE, CHOICE, FLAG, TEXT]), ANYTHING)
def test_any_value_is_allowed_or_refused_in_one_short_line(allowed, value):
    if found := refusal(allowed.check, "x", value):
        assert len(found) < 200
    else:
        checked = allowed.check("x", value)
        assert checked == value == allowed.check("x", checked)


def test_anything_is_shown_on_one_short_line_and_a_plain_name_plainly():
    assert short_repr(10**5000) == "a number too long to show"
    assert short_repr("two\nlines") == r"'two\nlines'"
    assert len(short_repr("x" * 10_000)) < 100
    names = ("gravity", "a b", "\x1b[31m", 3)
    assert [*map(short_name, names)] == ["gravity", "a b", r"'\x1b[31m'", "3"]
    assert short_name("x" * 61).startswith("'xxx")


@dataclasses.dataclass(frozen=True)
class Pump(ParameterGroup):
    """A group with a parameter of each kind, and a field that declares none."""

    flow: float = number(2.0, "l/s", "flow of the pump", 0.0, 9.0, exclusive=True, changeable=True)
    strokes: int = number(3, "", "strokes in a row", 1.0, 5.0, whole=True)
    mode: str = choice("idle", ("idle", "full"), "mode of the pump", changeable=True)
    reverse: bool = flag(False, "whether it turns back")
    log: str = text("", "a path", "file of its log")
    parts: tuple[str, ...] = ()


def test_a_declaration_says_everything_of_its_parameter():
    flow = Quantity("l/s", "flow of the pump", 0.0, 9.0, exclusive=True)
    assert list(declarations(Pump).values()) == [
        Declaration("flow", 2.0, flow, True),
        Declaration("strokes", 3, Quantity("", "strokes in a row", 1.0, 5.0, whole=True), False),
        Declaration("mode", "idle", Choice("mode of the pump", ("idle", "full")), True),
        Declaration("reverse", False, Flag("whether it turns back"), False),
        Declaration("log", "", Text("file of its log", "a path"), False),
    ]
    assert list(declarations(Pump)) == ["flow", "strokes", "mode", "reverse", "log"]
    assert list(quantities(Pump)) == ["flow", "strokes"]
    with pytest.raises(TypeError):
        declarations(Pump)["flow"] = None


def test_values_are_kept_in_their_types_or_refused_by_name():
    pump = Pump(flow=4, strokes=2.0)
    assert (type(pump.flow), type(pump.strokes)) == (float, int)
    complaint = "flow = 0 l/s is outside its range (0, 9] l/s"
    assert refusal(Pump, 0) == complaint
    assert refusal(lambda: dataclasses.replace(pump, flow=0)) == complaint


@given(st.integers())
def test_a_time_is_split_and_joined_without_loss(nanoseconds):
    seconds, rest = split_seconds(nanoseconds)
    assert 0 <= rest < SECOND
    assert join_seconds(seconds, rest) == nanoseconds
    assert split_fraction(nanoseconds) == (seconds, rest / SECOND)
