"""Words of a plot: numbers that are in its data, and nothing where there is nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.pages.plot import Axis, Bars, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.words import described, number

FORCE, TIME = Axis(unit="N"), Axis("time", "s")


def words(*layers, y=FORCE, x=TIME, alt=""):
    return described(Plot("force", layers, alt, y, x)).alt


def test_a_short_line_is_described_by_its_ends_and_a_long_one_by_its_extremes():
    x = np.array([1.0, 2.0, 3.0])
    assert words(Line("a", x, 10.0 * x)) == "a: 10 at 1 s, 30 at 3 s."
    x = np.linspace(0.0, 1.0, 100)
    assert words(Line("b", x, -x)) == "b: -1 to 0."


def test_what_the_plot_says_already_comes_first():
    assert words(Rule("mean", 5.0), alt="260 impacts.") == "260 impacts. mean: 5."


def test_a_name_with_its_number_needs_no_other():
    assert words(Rule("paper: 5.8 N", 5.8), Zone("400 to 2200 N", 400.0, 2200.0)) == ""
    assert words(Zone("tolerance", 1.0, 2.0)) == "tolerance: 1 to 2."


def test_a_single_point_of_the_paper_says_where_it_is():
    assert words(Points("paper", np.array([5.0]), np.array([470.0]))) == "paper: 470 at 5 s."


def test_values_that_are_no_numbers_are_left_out():
    x = np.arange(20.0)
    y = np.where(x == 3.0, np.nan, x)
    assert words(Line("a", x, y)) == "a: 0 to 19."
    assert words(Line("a", x, np.full(20, np.nan))) == "a: nothing."
    assert words(Line("a", x, y), y=Axis(unit="N", log=True)) == "a: 1 to 19."


def test_rounding_is_no_extreme():
    x = np.linspace(0.0, 1.0, 100)
    y = np.where(x == 0.0, -1e-20, x)
    assert words(Line("a", x, y)) == "a: 0 to 1."


def test_bars_and_shaded_points_are_described():
    edges = np.arange(11.0)
    counts = np.array([0, 0, 1, 50, 50, 50, 1, 0, 0, 0.0])
    assert words(Bars("counts", edges, counts)) == "counts: 90 % between 3 and 6."
    assert words(Bars("counts", edges, np.zeros(10))) == "counts: nothing."
    shaded = Points("points", edges[:2], edges[:2] + 5.0, values=np.array([3.0, 1.0]))
    assert words(shaded) == "points: least 1 at 1 s, 6 N; greatest 3."


def test_a_place_has_its_word():
    models = Axis("model", categories=("printed", "given"))
    marks = Points("mean", np.array([0.0, 1.0]), np.array([7.0, 8.0]))
    assert words(marks, x=models) == "mean: 7 at printed, 8 at given."


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
