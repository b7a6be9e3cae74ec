"""Lines on a screen: no peak is lost, no line crosses a gap."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rpud_sim.viewer.picture import with_gaps
from rpud_sim.viewer.views import thinned

VALUES = arrays.arrays(float, st.integers(0, 300), elements=st.floats(-1e9, 1e9))


@given(VALUES, st.integers(2, 50))
def test_thinning_keeps_both_ends_and_every_extreme_and_invents_nothing(values, most):
    times = np.arange(len(values), dtype=float)
    line = thinned(times, values, most)
    assert len(line["t"]) <= max(most + 2, 4)
    assert (values[line["t"].astype(int)] == line["mean"]).all()
    assert (np.diff(line["t"]) > 0.0).all()
    if len(values):
        assert (line["mean"].min(), line["mean"].max()) == (values.min(), values.max())
        assert (line["t"][0], line["t"][-1]) == (times[0], times[-1])


def test_a_line_ends_at_a_gap():
    layer = with_gaps({"t": np.array([0.0, 1.0, 2.0, 9.0, 10.0]), "mean": np.arange(5.0)})
    assert np.isnan(layer["mean"]).tolist() == [False, False, False, True, False, False]
    assert 2.0 < layer["t"][3] < 9.0


def test_an_empty_bin_now_and_then_does_not_break_a_line():
    means = np.array([1.0, 1.0, np.nan, 1.0, 1.0, 1.0])
    layer = with_gaps({"t": np.arange(6.0), "mean": means})
    assert np.isfinite(layer["mean"]).all()
