"""What is kept of a run: bins contain every value, impacts are spread as they are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.viewer import bins as module
from rpud_sim.viewer.bins import Bins, Impacts

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


@given(pairs=samples, start=st.floats(0.0, 900.0), newest=st.booleans())
def test_the_latest_value_is_the_last_one_that_a_view_shows(pairs, start, newest):
    bins = Bins(["x"], 0.05, 256, newest=newest)
    bins.add("x", *np.array(pairs).T)
    shown = bins.view("x", start, start + 50.0, 1 << 20)["mean"]
    expected = shown[np.isfinite(shown)][-1:].tolist() or [np.nan]
    np.testing.assert_equal(bins.latest("x", start, start + 50.0), *expected)


def test_before_what_is_kept_there_is_no_latest_value():
    bins = Bins(["x"], 1.0, 16, newest=True)
    bins.add("x", np.arange(40.0), np.arange(40.0))
    assert bins.first > 4
    assert np.isnan(bins.latest("x", bins.first - 4.0, bins.first - 3.0))
    assert bins.latest("x", bins.first - 4.0, bins.first + 1.0) == bins.first + 1.0


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


moments = st.lists(st.floats(0.0, 100.0), max_size=200)


def filled(times, peaks, parts=1):
    found = Impacts()
    for chosen in np.array_split(np.arange(len(times)), parts):
        found.add(np.asarray(times)[chosen], np.asarray(peaks)[chosen])
    return found


@given(times=moments, parts=st.integers(1, 5), count=st.integers(1, 50))
def test_every_impact_is_in_one_part(times, parts, count):
    found = filled(times, np.ones(len(times)), parts)
    spread = found.spread(0.0, 100.0, count)
    width = np.diff(spread["t"])[0] if len(spread["t"]) > 1 else 2 * spread["t"][0]
    inside = [time for time in times if time < spread["t"][-1] + width / 2]
    assert found.rate(0.0, 100.0, count)["mean"].sum() * width == pytest.approx(len(inside))


def test_mean_and_band_are_those_of_the_part():
    peaks = np.arange(1.0, 101.0)
    spread = filled(np.full(100, 0.5), peaks).spread(0.0, 1.0, 1)
    part = np.flatnonzero(np.isfinite(spread["mean"]))
    assert len(part) == 1
    assert spread["mean"][part] == 50.5
    np.testing.assert_allclose(
        [spread["low"][part][0], spread["high"][part][0]], [6.0, 95.0], atol=1.0
    )


def test_outliers_beyond_the_most_are_counted():
    peaks = np.where(np.arange(100_000) % 100, 1000.0, 9000.0)
    spread = filled(np.linspace(0.0, 1.0, 100_000), peaks).spread(0.0, 1.0, 1)
    assert len(spread["outliers"]["v"]) + spread["outliers"]["more"] == 1000
    assert len(spread["outliers"]["v"]) == module.MOST_OUTLIERS
    assert np.nanmax(spread["high"]) < 1200.0  # they do not widen the band


def test_of_many_impacts_every_second_stays_and_the_rate_is_right(monkeypatch):
    monkeypatch.setattr(module, "MOST", 1000)
    times = np.linspace(0.0, 10.0, 10_000, endpoint=False)
    found = filled(times, np.ones(10_000), 7)
    assert found.total == 10_000
    assert len(found.between(0.0, 10.0)[0]) <= 1000
    assert found.rate(0.0, 8.0, 4)["mean"][1] == pytest.approx(1000.0, rel=0.05)


def test_impacts_may_come_in_any_order():
    found = filled([3.0, 1.0, 2.0], [30.0, 10.0, 20.0])
    times, peaks = found.between(0.0, 2.5)
    assert (times.tolist(), peaks.tolist()) == ([1.0, 2.0], [10.0, 20.0])


def test_garbage_counts_as_impacts_and_leaves_the_band_of_the_others():
    found = filled([0.1, 0.2, 0.3, 0.4, 0.5], [10.0, np.nan, 12.0, -1e300, np.inf])
    spread = found.spread(0.0, 1.0, 1)
    assert (spread["low"][0], spread["high"][0]) == pytest.approx((10.0, 12.0), rel=1e-3)
    assert spread["mean"][0] == pytest.approx(11.0)
    assert found.total == 5
