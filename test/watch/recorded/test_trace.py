"""Lines on a screen: no peak is lost, no line crosses a gap."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rpud_sim.watch.recorded.trace import envelope, held, thinned, with_gaps

VALUES = arrays.arrays(float, st.integers(0, 300), elements=st.floats(-1e9, 1e9))


@given(VALUES, st.integers(2, 50))
def test_thinning_keeps_both_ends_and_every_extreme_and_invents_nothing(values, most):
    times = np.arange(len(values), dtype=float)
    trace = thinned(times, values, most)
    assert len(trace.x) <= max(most + 2, 4)
    assert (values[trace.x.astype(int)] == trace.y).all()
    assert (np.diff(trace.x) > 0.0).all()
    if len(values):
        assert (trace.y.min(), trace.y.max()) == (values.min(), values.max())
        assert (trace.x[0], trace.x[-1]) == (times[0], times[-1])


def value_at(trace, time):
    """Return the value of the last point at or before a time."""
    return trace.y[np.searchsorted(trace.x, time, "right") - 1]


def test_a_line_ends_at_a_gap():
    trace = with_gaps(np.array([0.0, 1.0, 2.0, 9.0, 10.0]), np.arange(5.0))
    assert np.isnan(value_at(trace, 5.5))
    assert np.isnan(trace.y).sum() == 1


def test_a_held_value_lasts_to_the_next_but_not_over_a_gap():
    trace = held(np.array([0.0, 1.0, 2.0, 9.0]), np.array([5.0, 6.0, 7.0, 8.0]), 9.5)
    assert value_at(trace, 0.9) == 5.0
    assert np.isnan(value_at(trace, 5.0))
    assert (trace.x[-1], value_at(trace, 9.4)) == (9.5, 8.0)


def test_parts_that_may_have_unread_values_between_them_are_not_joined():
    times, values = np.array([0.0, 1.0, 2.0, 5.0, 8.0]), np.ones(5)
    known = envelope(times, values, values, 1.0)
    assert np.isnan(known.y).sum() == 0  # a part is missing now and then
    assert np.isnan(envelope(times, values, values, 1.0, known=3.0).y).sum() == 2
