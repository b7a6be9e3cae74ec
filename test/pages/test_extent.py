"""Axes hold all that is drawn, and units make numbers short."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rpud_sim.pages.extent import axis_ends, readable_unit
from rpud_sim.pages.plot import Axis, Line, Plot

numbers = st.floats(-1e12, 1e12)


@given(st.lists(st.one_of(numbers, st.just(np.nan)), min_size=1, max_size=20))
def test_an_axis_holds_all_values(values):
    found = np.array(values)
    low, high = axis_ends(Plot("a", (Line("b", np.arange(float(len(values))), found),)), "y")
    assert low < high
    shown = found[np.isfinite(found)]
    assert (shown >= low).all()
    assert (shown <= high).all()


@given(st.lists(st.floats(-1.0, 1e9), min_size=1, max_size=20))
@example([258737.0, 1.4392717472011676e-303])
def test_a_logarithmic_axis_holds_what_is_positive(values):
    found = np.array(values)
    line = Line("b", np.arange(float(len(values))), found)
    low, high = axis_ends(Plot("a", (line,), y=Axis(log=True)), "y")
    assert 0.0 < low < high
    assert (found[found > 0.0] >= low * (1.0 - 1e-12)).all()


@given(st.floats(1e-9, 1e11))
def test_a_readable_unit_leaves_one_to_three_digits_before_the_point(greatest):
    factor, unit = readable_unit("N", greatest)
    assert 0.999 <= factor * greatest < 1000.1
    assert unit.endswith("N")
    assert factor * greatest == pytest.approx(
        greatest
        / {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}.get(unit[:-1], 1.0)
    )
