"""Intervals cover, decisions are corrected for their number, and equivalence has to be shown."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import false_discovery_control, ttest_ind
from support import examples

from rpud_sim.inspection.compare.estimates import (
    DIFFERS,
    EQUIVALENT,
    SAME,
    TOO_FEW,
    UNDECIDED,
    corrected,
    decide,
    difference,
    estimate,
)
from rpud_sim.inspection.compare.values import MEAN, MEDIAN, P95, ComparedQuantity

FORCE = ComparedQuantity("peak_force", "N", "contact_force", "peak_force")


def values(count, mean=100.0, seed=0):
    return np.random.default_rng(seed).normal(mean, 10.0, count)


def compared(first, second, tolerance=0.0, figure=MEAN, **options):
    pair = [estimate(each, figure) for each in (first, second)]
    found = difference(FORCE, figure, *pair, tolerance, **options)
    return found, decide(found, found.chance, tolerance)


@pytest.mark.parametrize(("figure", "true"), [(MEAN, 100.0), (MEDIAN, 100.0), (P95, 116.4485)])
def test_intervals_cover_nineteen_of_twenty(figure, true):
    found = [estimate(values(300, seed=seed), figure) for seed in range(200)]
    share = np.mean([each.low <= true <= each.high for each in found])
    assert 0.9 <= share <= 0.99
    assert all(each.low <= each.value <= each.high for each in found)


def test_huge_values_are_compared():
    _, decision = compared(np.full(64, 2.0**1000), np.full(64, 2.0**999))
    assert decision == DIFFERS


def test_the_chance_is_that_of_welchs_test_where_values_are_independent():
    first, second = values(2000, seed=1), values(1000, 101.0, seed=2)
    found, _ = compared(first, second)
    expected = ttest_ind(first, second, equal_var=False)
    assert found.value / (0.5 * (found.high - found.low) / 1.96) == pytest.approx(
        -expected.statistic, rel=0.1
    )
    assert found.relative == pytest.approx(second.mean() / first.mean() - 1.0, rel=1e-12)


def test_holms_correction():
    assert corrected([0.01, 0.04, math.nan, 0.03]) == pytest.approx(
        [0.03, 0.06, math.nan, 0.06], nan_ok=True
    )
    assert corrected([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30))
def test_a_correction_keeps_the_order_and_is_stricter_than_benjamini_and_hochberg(chances):
    found = corrected(chances)
    assert all(a <= b <= 1.0 for a, b in zip(chances, found, strict=True))
    order = np.argsort(chances, kind="stable")
    assert (np.diff(np.array(found)[order]) >= 0.0).all()
    weaker = false_discovery_control(chances)
    assert all(b >= a - 1e-12 for a, b in zip(weaker, found, strict=True))


def test_decisions():
    assert compared(values(500), values(500, seed=1))[1] == SAME
    assert compared(values(500), values(500, 110.0, seed=1))[1] == DIFFERS
    assert compared(values(500), values(500, seed=1), 0.05)[1] == EQUIVALENT
    assert compared(values(500), values(500, 103.0, seed=1), 0.05)[1] == EQUIVALENT
    assert compared(values(500), values(500, 105.0, seed=1), 0.05)[1] == UNDECIDED
    assert compared(values(500), values(500, 110.0, seed=1), 0.05)[1] == DIFFERS
    assert compared(values(500), values(500, 90.0, seed=1), 0.05)[1] == DIFFERS
    assert compared(values(45), values(45, seed=1), 0.001)[1] == UNDECIDED


@pytest.mark.parametrize("count", [0, 1, 3, 39])
def test_too_few_values_decide_nothing(count):
    found, decision = compared(values(count), values(500))
    assert decision == TOO_FEW
    assert math.isnan(found.chance)
    assert math.isnan(found.low)


def test_equal_values_are_equal_within_any_tolerance():
    found, decision = compared(values(50), values(50), 1e-9, equal=True)
    assert (found.value, found.low, found.high, found.relative) == (0.0,) * 4
    assert decision == EQUIVALENT


def test_constants_differ_if_they_are_different_beyond_rounding():
    first = np.full(100, 3.0)
    assert compared(first, np.full(100, 3.0 * (1.0 + 1e-12)))[1] == SAME
    assert compared(first, np.full(100, 3.001))[1] == DIFFERS
    # Noise of rounding around zero is no difference either.
    pair = [estimate(np.full(100, value), MEAN, 1e-9) for value in (1e-14, -3e-14)]
    assert difference(FORCE, MEAN, *pair).chance > 0.9


def test_a_figure_that_may_be_zero_has_no_ratio_and_is_tested_without_tolerance():
    found, decision = compared(values(500, 0.0), values(500, 0.0, seed=1), 0.01)
    assert math.isnan(found.relative)
    assert decision == SAME
    assert compared(values(500, 0.0), values(500, 5.0, seed=1), 0.01)[1] == DIFFERS


@settings(max_examples=examples(50))
@given(
    st.lists(st.floats(-1e12, 1e12), min_size=4, max_size=80),
    st.lists(st.floats(-1e12, 1e12), min_size=4, max_size=80),
    st.sampled_from([MEAN, MEDIAN, P95]),
    st.sampled_from([0.0, 0.05]),
)
def test_any_values_give_a_decision(first, second, figure, tolerance):
    found, decision = compared(np.array(first), np.array(second), tolerance, figure)
    assert decision in (DIFFERS, SAME, EQUIVALENT, UNDECIDED, TOO_FEW)
    assert math.isnan(found.chance) == (decision == TOO_FEW)
    if decision != TOO_FEW:
        assert 0.0 <= found.chance <= 1.0
