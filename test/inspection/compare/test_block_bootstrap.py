"""The error of a mean is that of the stationary bootstrap, and covers where values depend."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from rpud_sim.inspection.compare.block_bootstrap import (
    autocovariances,
    block_length,
    grouped,
    mean_error,
    mean_variance,
)


def series(count, memory, seed):
    """Give a stationary series in which each value keeps a part of the one before."""
    noise = np.random.default_rng(seed).normal(size=count)
    values = np.empty(count)
    values[0] = noise[0] / math.sqrt(1.0 - memory**2)
    for i in range(1, count):
        values[i] = memory * values[i - 1] + noise[i]
    return values


def test_correlations_of_rounding_alone_have_a_longest_block():
    assert block_length(np.array([1e-300, *[1.0] * 9])) == 3.0 + 1.0 / 3.0


def resampled_means(values, length, repeats, seed):
    """Give means of series that are drawn block by block, as Politis and Romano do."""
    random = np.random.default_rng(seed)
    count = len(values)
    begins = random.random((repeats, count)) < 1.0 / length
    begins[:, 0] = True
    places = np.where(begins, random.integers(0, count, (repeats, count)), 0)
    steps = np.arange(count)
    last = np.maximum.accumulate(np.where(begins, steps, 0), axis=1)
    return values[(np.take_along_axis(places, last, 1) + steps - last) % count].mean(axis=1)


@pytest.mark.parametrize("length", [1.0, 3.0, 20.0])
def test_the_closed_form_is_what_drawing_gives(length):
    values = series(200, 0.6, 1)
    drawn = resampled_means(values, length, 4000, 2).var()
    assert mean_variance(autocovariances(values), length) == pytest.approx(drawn, rel=0.1)


def test_autocovariances_are_their_definition():
    values = series(50, 0.5, 3)
    apart = values - values.mean()
    expected = [(apart[: 50 - lag] * apart[lag:]).sum() / 50 for lag in range(50)]
    assert autocovariances(values) == pytest.approx(expected, abs=1e-12)


def test_blocks_grow_with_memory():
    lengths = [block_length(autocovariances(series(4000, m, 4))) for m in (0.0, 0.5, 0.9)]
    assert lengths[0] < 3.0
    assert lengths[0] < lengths[1] < lengths[2]
    # The length that theory gives for this series: (G / g)^(2/3) n^(1/3), G and g of its spectrum.
    best = (2.0 * 0.9 / (1.0 - 0.9**2)) ** (2.0 / 3.0) * 4000 ** (1.0 / 3.0)
    assert lengths[2] == pytest.approx(best, rel=0.5)


@pytest.mark.parametrize("memory", [-0.5, 0.0, 0.8])
def test_the_error_is_the_spread_of_means(memory):
    errors = [mean_error(series(1000, memory, seed)) for seed in range(40)]
    true = 1.0 / (1.0 - memory) / math.sqrt(1000)
    assert np.median([each.error for each in errors]) == pytest.approx(true, rel=0.2)
    assert all(8.0 <= each.blocks <= 1000.0 for each in errors)


def test_a_constant_has_no_error():
    assert mean_error(np.full(100, 3.5)).error == 0.0


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300), st.integers(1, 40))
def test_groups_are_means_of_neighbours(values, most):
    found = grouped(np.array(values), most)
    size = -(-len(values) // most)
    assert len(found) == len(values) // size <= most
    assert found[0] == pytest.approx(np.mean(values[:size]), rel=1e-9, abs=1e-6)


@given(st.lists(st.floats(-1e9, 1e9), min_size=4, max_size=200))
@example([0.0, 0.0, 0.0, 9.160756580545566e-158])
@example([0.0, 0.0, 0.0, 1.680047243702885e-96])
def test_any_series_has_a_finite_error(values):
    found = mean_error(np.array(values))
    assert math.isfinite(found.error)
    assert found.error >= 0.0
    assert found.blocks >= 1.0
