"""Words of a plot: numbers that are in its data, and nothing where there is nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.pages.plot import Axis, Line, Plot
from rpud_sim.pages.words import described, number

FORCE, TIME = Axis(unit="N"), Axis("time", "s")


def words(*layers, y=FORCE, x=TIME, alt=""):
    return described(Plot("force", layers, alt, y, x)).alt


def test_values_that_are_no_numbers_are_left_out():
    x = np.arange(20.0)
    y = np.where(x == 3.0, np.nan, x)
    assert words(Line("a", x, y)) == "a: 0 to 19."
    assert words(Line("a", x, np.full(20, np.nan))) == "a: nothing."
    assert words(Line("a", x, y), y=Axis(unit="N", log=True)) == "a: 1 to 19."


@given(st.lists(st.floats(), max_size=40))
def test_any_data_have_words(values):
    array = np.array(values, float)
    text = words(Line("a", np.arange(len(array), dtype=float), array))
    assert text.startswith("a: ")
    assert "nan" not in text
    assert "inf" not in text
    finite = array[np.isfinite(array)]
    if len(finite) > 12:
        assert number(finite.max()) in text or finite.max() < 1e-9 * np.abs(finite).max()
