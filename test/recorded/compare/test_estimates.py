"""Errors are the spread of means, intervals cover, and decisions are corrected."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.recorded.compare.estimates import (
    DIFFERS,
    EQUIVALENT,
    SAME,
    TOO_FEW,
    UNDECIDED,
    decided,
    difference,
    estimate,
    mean_error,
)
from rpud_sim.recorded.compare.values import MEAN, MEDIAN, P95, ComparedQuantity

FORCE = ComparedQuantity("peak_force", "N", "contact_force", "peak_force")


def series(count, memory, seed):
    """Give a stationary series in which each value keeps a part of the one before."""
    noise = np.random.default_rng(seed).normal(size=count)
    values = np.empty(count)
    values[0] = noise[0] / math.sqrt(1.0 - memory**2)
    for i in range(1, count):
        values[i] = memory * values[i - 1] + noise[i]
    return values


@pytest.mark.parametrize(("memory", "count"), [(-0.5, 1000), (0.8, 1000), (0.8, 2**16 + 7)])
def test_the_error_is_the_spread_of_means(memory, count):
    errors, batches = zip(
        *(mean_error(series(count, memory, seed)) for seed in range(40 if count == 1000 else 1)),
        strict=True,
    )
    assert np.median(errors) == pytest.approx(1.0 / (1.0 - memory) / math.sqrt(count), rel=0.2)
    assert 8 <= min(batches) <= max(batches) <= 32


def values(count, mean=100.0, seed=0):
    return np.random.default_rng(seed).normal(mean, 10.0, count)


def compared(first, second, tolerance=0.0, figure=MEAN, **options):
    pair = [estimate(each, figure) for each in (first, second)]
    [found] = decided([difference(FORCE, figure, *pair, tolerance, **options)], tolerance)
    return found


@pytest.mark.parametrize(("figure", "true"), [(MEAN, 100.0), (MEDIAN, 100.0), (P95, 116.4485)])
def test_intervals_cover_nineteen_of_twenty(figure, true):
    found = [estimate(values(300, seed=seed), figure) for seed in range(200)]
    share = np.mean([each.low <= true <= each.high for each in found])
    assert 0.9 <= share <= 0.99
    assert all(each.low <= each.value <= each.high for each in found)


def test_holms_correction_leaves_out_what_is_not_tested():
    one = difference(FORCE, MEAN, *[estimate(values(50), MEAN)] * 2, equal=True)
    chances = [0.01, 0.04, math.nan, 0.03]
    found = [each.p for each in decided([one._replace(p=p) for p in chances], 0.0)]
    assert found == pytest.approx([0.03, 0.06, math.nan, 0.06], nan_ok=True)


@pytest.mark.parametrize(
    ("count", "mean", "tolerance", "decision"),
    [
        (500, 100.0, 0.0, SAME),
        (500, 110.0, 0.0, DIFFERS),
        (500, 103.0, 0.05, EQUIVALENT),
        (500, 105.0, 0.05, UNDECIDED),
        (500, 110.0, 0.05, DIFFERS),
        (500, 90.0, 0.05, DIFFERS),
        (45, 100.0, 0.001, UNDECIDED),
        (39, 100.0, 0.0, TOO_FEW),
        (3, 100.0, 0.0, TOO_FEW),
        (0, 100.0, 0.0, TOO_FEW),
    ],
)
def test_decisions(count, mean, tolerance, decision):
    found = compared(values(count), values(max(count, 45), mean, seed=1), tolerance)
    assert found.decision == decision
    assert math.isnan(found.p) == math.isnan(found.low) == (decision == TOO_FEW)


def test_a_figure_that_may_be_zero_has_no_ratio_and_is_tested_without_tolerance():
    found = compared(values(500, 0.0), values(500, 0.0, seed=1), 0.01)
    assert math.isnan(found.relative)
    assert found.decision == SAME
    assert compared(values(500, 0.0), values(500, 5.0, seed=1), 0.01).decision == DIFFERS


@settings(max_examples=examples(50))
@given(
    st.lists(st.floats(-1e12, 1e12), min_size=4, max_size=80),
    st.lists(st.floats(-1e12, 1e12), min_size=4, max_size=80),
    st.sampled_from([MEAN, MEDIAN, P95]),
    st.sampled_from([0.0, 0.05]),
)
def test_any_values_give_a_decision(first, second, figure, tolerance):
    found = compared(np.array(first), np.array(second), tolerance, figure)
    assert found.decision in (DIFFERS, SAME, EQUIVALENT, UNDECIDED, TOO_FEW)
    assert math.isnan(found.p) if found.decision == TOO_FEW else 0.0 <= found.p <= 1.0
