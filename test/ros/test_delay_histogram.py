"""Delays are reported to within a few per cent, however many there are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.ros.delay_histogram import DelayHistogram


def test_nothing_is_not_late():
    lateness = DelayHistogram()
    assert (lateness.count, lateness.quantile(0.5), lateness.greatest) == (0, 0.0, 0.0)
    lateness.add(-5.0)
    assert (lateness.count, lateness.quantile(0.99), lateness.greatest) == (1, 0.0, 0.0)


@given(st.lists(st.floats(0.0, 1e13), min_size=1), st.floats(0.0, 1.0, exclude_min=True))
def test_quantiles_are_little_too_large_and_never_too_small(delays, share):
    lateness = DelayHistogram()
    for delay in delays:
        lateness.add(delay)
    exact = np.quantile(delays, share, method="inverted_cdf") / 1e9
    assert exact * (1 - 1e-12) <= lateness.quantile(share) <= 1.045 * exact + 1e-6
    assert lateness.greatest == pytest.approx(max(delays) / 1e9)


def test_its_memory_does_not_grow_with_their_number():
    lateness = DelayHistogram()
    for number in range(100_000):
        lateness.add(float(number))
    assert len(lateness._counts) < 200
    assert str(lateness) == "late 0.0515 ms (median), 0.1 ms (99 %), 0.1 ms (most)"
