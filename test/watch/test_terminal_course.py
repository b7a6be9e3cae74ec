"""Courses over the last minute: a column for the same bins, a character for each value."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.watch.picture import COLUMNS, Series
from rpud_sim.watch.terminal_course import ASCII, BLOCKS, columns_of, sparkline

PERIOD = 0.05


def series(first=0, **columns):
    """Give a fast series of some columns; the others are empty."""
    length = len(next(iter(columns.values())))
    rows = np.full((length, len(COLUMNS)), np.nan)
    for name, values in columns.items():
        rows[:, COLUMNS.index(name)] = values
    return Series(first, PERIOD, COLUMNS, rows)


def test_a_sparkline_has_a_gap_where_nothing_is_known():
    assert sparkline([math.nan, 0.0, 1.0, 4.0, 8.0], BLOCKS) == " ▁▂▅█"
    assert sparkline([math.nan, 0.0, 0.0], ASCII) == " .."
    assert sparkline([]) == ""


@given(
    values=st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=50),
    steps=st.sampled_from((BLOCKS, ASCII)),
)
def test_a_sparkline_has_one_character_for_each_value_and_rises_with_it(values, steps):
    drawn = sparkline(values, steps)
    assert len(drawn) == len(values)
    assert set(drawn) <= set(steps)
    known = sorted((v, steps.index(c)) for v, c in zip(values, drawn, strict=True) if c != steps[0])
    assert [level for _, level in known] == sorted(level for _, level in known)


@given(first=st.integers(0, 5000), length=st.integers(1, 1200), count=st.integers(1, 100))
def test_the_columns_of_a_sparkline_cover_whole_bins_that_stay_together(first, length, count):
    """A column that is shown has the same value as long as its bins are there."""
    numbers = np.arange(first, first + length, dtype=float)
    bins = max(1, math.ceil(60.0 / count / PERIOD))
    drawn = columns_of(series(first, impacts=numbers), "impacts", count, total=False)
    assert len(drawn) == count
    end = (first + length - 1) // bins
    for place, value in enumerate(drawn):
        number = end - count + place
        whole = [n for n in range(number * bins, (number + 1) * bins) if n >= first]
        if number >= 0 and whole:
            assert value == whole[-1]
        else:
            assert math.isnan(value)
