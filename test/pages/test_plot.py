"""Axes hold all that is drawn and all intervals; ticks are round, and apart."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from rpud_sim.pages.plot import Axis, Line, Plot, Points, axis_ends, scale_of

numbers = st.floats(-1e12, 1e12)


def line_of(values, **axis):
    found = np.array(values)
    return Plot("a", (Line("b", np.arange(float(len(values))), found),), y=Axis(**axis))


@given(st.lists(st.one_of(numbers, st.just(np.nan)), min_size=1, max_size=20))
def test_an_axis_holds_all_values(values):
    low, high = axis_ends(line_of(values), "y")
    assert low < high
    shown = [value for value in values if math.isfinite(value)]
    assert all(low <= value <= high for value in shown)


@given(st.lists(st.floats(-1.0, 1e9), min_size=1, max_size=20))
@example([258737.0, 1.4392717472011676e-303])
def test_a_logarithmic_axis_holds_what_is_positive(values):
    low, high = axis_ends(line_of(values, log=True), "y")
    assert 0.0 < low < high
    assert all(low * (1.0 - 1e-9) <= value for value in values if value > 1e-150)


@given(st.lists(st.tuples(numbers, st.floats(0.0, 1e6), st.floats(0.0, 1e6)), min_size=1))
def test_an_axis_holds_whole_intervals(items):
    value, under, over = np.array(items).T
    points = Points("a", value, np.arange(len(value)), value - under, value + over, across=True)
    low, high = axis_ends(Plot("b", (points,)), "x")
    assert low <= (value - under).min()
    assert (value + over).max() <= high


@given(st.floats(-1e9, 1e9), st.floats(1e-6, 1e9), st.floats(50.0, 2000.0), st.booleans())
def test_ticks_are_inside_apart_and_differ(low, width, pixels, log):
    low = abs(low) + 1e-3 if log else low
    high = low + width
    assume(high - low > 1e-9 * max(abs(low), abs(high)))
    plot = line_of([low, high], log=log, low=low, high=high)
    scale = scale_of(plot, "y", 0.0, pixels)
    ticks = scale.ticks(40.0)
    values = np.array([value for value, _ in ticks])
    assert len(values) <= max(3, pixels / 40.0 + 2)
    places = scale(values)
    assert (places > -1.0).all()
    assert (places < pixels + 1.0).all()
    assert len({text for _, text in ticks}) == len(ticks) or width < 1e-6 * abs(low)


@pytest.mark.parametrize(
    ("ends", "log", "texts"),
    [
        ((0.0, 10.0), False, ["0", "2", "4", "6", "8", "10"]),
        ((-0.6, 0.6), False, ["−0.6", "−0.4", "−0.2", "0.0", "0.2", "0.4", "0.6"]),
        ((1.0, 1000.0), True, ["1", "10", "100", "1000"]),
        ((3.0, 30.0), True, ["3", "5", "10", "20", "30"]),
    ],
)
def test_ticks_are_round_numbers(ends, log, texts):
    plot = line_of(ends, log=log, low=ends[0], high=ends[1])
    scale = scale_of(plot, "y", 0.0, 240.0)
    assert [text for _, text in scale.ticks(40.0)] == texts


def test_words_take_the_place_of_numbers():
    plot = line_of([0.0, 1.0], categories=("a", "b"), flipped=True)
    scale = scale_of(plot, "y", 100.0, 0.0)
    assert scale.ticks(40.0) == [(0.0, "a"), (1.0, "b")]
    top, bottom = scale([0.0, 1.0])
    assert top < bottom
