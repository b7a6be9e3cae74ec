"""An envelope contains every value, however far one looks from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.viewer.history import Bins

samples = st.lists(
    st.tuples(st.floats(0.0, 1000.0), st.floats(-1e6, 1e6)), min_size=1, max_size=100
)


@given(pairs=samples, parts=st.integers(1, 200))
def test_least_mean_and_greatest_are_those_of_the_values(pairs, parts):
    times, values = np.array(pairs).T
    bins = Bins(["x"], 0.05, 256)
    for chosen in np.array_split(np.arange(len(times)), 3):
        bins.add("x", times[chosen], values[chosen])
    seen = bins.view("x", 0.0, 1000.0, parts)
    assert np.nanmin(seen["low"]) == values.min()
    assert np.nanmax(seen["high"]) == values.max()
    known = np.isfinite(seen["mean"])
    assert (seen["low"][known] <= seen["mean"][known] + 1e-6).all()
    assert (seen["mean"][known] <= seen["high"][known] + 1e-6).all()
    assert bins.end == times.max()


def test_bins_grow_with_the_run_and_take_no_more_memory():
    bins = Bins(["x", "y"], 0.05, 64)
    bins.add("x", np.arange(0.0, 100.0, 0.01), np.ones(10_000))
    assert bins.width == pytest.approx(1.6)
    assert bins.has("x")
    assert not bins.has("y")


def test_parts_stay_when_the_range_moves():
    bins = Bins(["x"], 0.05, 4096)
    bins.add("x", np.arange(0.0, 60.0, 0.01), np.sin(np.arange(0.0, 60.0, 0.01)))
    first, second = bins.view("x", 10.0, 30.0, 100), bins.view("x", 10.31, 30.31, 100)
    shared = np.intersect1d(first["t"], second["t"])
    assert len(shared) > 90
    np.testing.assert_array_equal(
        first["mean"][np.isin(first["t"], shared)][1:-1],
        second["mean"][np.isin(second["t"], shared)][1:-1],
    )


def test_where_nothing_was_heard_nothing_is_shown():
    bins = Bins(["x"], 0.05, 256)
    bins.add("x", np.array([1.0, 5.0, 6.0]), np.array([1.0, np.nan, 2.0]))
    seen = bins.view("x", 0.0, 8.0, 160)
    assert np.isfinite(seen["mean"]).sum() == 2
    assert not len(Bins(["x"], 0.05, 16).view("x", 5.0, 4.0, 10)["t"])


@given(pairs=samples)
def test_the_newest_bins_stay_as_fine_as_at_the_beginning(pairs):
    pairs = sorted(pairs)
    bins = Bins(["x"], 0.05, 256, newest=True)
    for time, value in pairs:
        bins.add("x", np.array([time]), np.array([value]))
    bins.add("x", np.array([0.0, 1.0]), np.array([1e9, 1e9]))  # too old, or among the first
    assert bins.width == 0.05
    end = pairs[-1][0]
    kept = max(bins.first * bins.width, 1.1)
    assert end - bins.first * bins.width >= min(end, 127 * 0.05)
    seen = bins.view("x", kept, end, 10_000)
    new = [value for time, value in pairs if time >= kept + 0.05]
    inside = seen["t"] > kept + 0.05
    assert np.nanmax(seen["high"][inside], initial=-np.inf) >= max(new, default=-np.inf)
    assert np.nanmax(seen["high"][inside], initial=-np.inf) < 1e9
