"""Verdicts on two versions' times: differences are found, and copies of one version have none."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.ratios import FASTER, INCOMPARABLE, SAME, SLOWER, judge


def pairs(ratio, count=8, noise=0.02, drift=0.5, seed=5):
    """Return times with a spread, on a machine that becomes slower as they are taken."""
    random = np.random.default_rng(seed)
    machine = 1.0 + drift * np.arange(count) / count
    spread = np.exp(random.normal(0.0, noise, (count, 2)))
    return [(2.0 * m * a, 2.0 * m * b * ratio) for m, (a, b) in zip(machine, spread, strict=True)]


def verdict(ratio, **options):
    return judge({"work": pairs(ratio, **options)})[0]


@pytest.mark.parametrize(
    ("ratio", "expected"), [(1.0, SAME), (1.01, SAME), (1.2, SLOWER), (0.8, FASTER)]
)
def test_a_verdict_is_that_of_the_ratio(ratio, expected):
    found = verdict(ratio)

    assert found.verdict == expected
    assert found.low < found.value < found.high
    assert found.value == pytest.approx(ratio, rel=0.03)


def test_only_a_whole_interval_above_the_threshold_is_a_failure():
    assert verdict(1.3).beyond(0.1)
    assert not verdict(1.1).beyond(0.1)  # the interval begins below
    assert not verdict(1.3, noise=0.3).beyond(0.1)  # is not certain
    assert not verdict(0.5).beyond(0.1)


@given(st.integers(0, 2**32), st.floats(0.5, 2.0))
def test_versions_that_change_places_give_the_inverse(seed, ratio):
    times = pairs(ratio, seed=seed)

    [found] = judge({"work": times})
    [inverse] = judge({"work": [(second, first) for first, second in times]})

    assert inverse.value == pytest.approx(1.0 / found.value)
    assert inverse.low == pytest.approx(1.0 / found.high)
    swapped = {SLOWER: FASTER, FASTER: SLOWER, SAME: SAME}
    assert inverse.verdict == swapped[found.verdict]


def test_many_comparisons_of_equal_versions_rarely_see_a_difference():
    alarms = sum(
        any(
            ratio.verdict != SAME
            for ratio in judge(
                {str(work): pairs(1.0, noise=0.1, seed=8 * seed + work) for work in range(8)}
            )
        )
        for seed in range(200)
    )
    assert alarms <= 0.05 * 200


def test_an_interval_covers_the_ratio_as_often_as_it_says():
    found = [verdict(1.2, noise=0.1, seed=seed) for seed in range(400)]

    covered = sum(each.low <= 1.2 <= each.high for each in found)

    assert 0.92 * 400 < covered < 0.98 * 400


def test_what_cannot_be_compared_says_why():
    found = judge({"short": pairs(1.0, count=2)}, {"broken": "base: no such command"})

    assert [each.verdict for each in found] == [INCOMPARABLE] * 2
    assert str(found[0]) == "short: cannot be compared: fewer than 3 pairs of times"
    assert str(found[1]) == "broken: cannot be compared: base: no such command"
    assert all(math.isnan(each.value) and not each.beyond(0.1) for each in found)


def test_equal_times_are_no_difference():
    [found] = judge({"work": [(1.0, 1.0)] * 5})

    assert (found.verdict, found.low, found.high) == (SAME, 1.0, 1.0)
