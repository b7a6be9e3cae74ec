"""Times are split into seconds and nanoseconds and joined again without loss."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.time import SECOND, join_seconds, split_fraction, split_seconds


@given(st.integers())
def test_a_time_is_split_and_joined_without_loss(nanoseconds):
    seconds, rest = split_seconds(nanoseconds)
    assert 0 <= rest < SECOND
    assert join_seconds(seconds, rest) == nanoseconds


@pytest.mark.parametrize(
    ("nanoseconds", "parts"),
    [(0, (0, 0)), (1_500_000_000, (1, 500_000_000)), (-1, (-1, 999_999_999))],
)
def test_the_nanoseconds_are_never_negative(nanoseconds, parts):
    assert split_seconds(nanoseconds) == parts


def test_a_fraction_is_the_rest_of_the_second():
    assert split_fraction(2_250_000_000) == (2, 0.25)
    assert split_fraction(-250_000_000) == (-1, 0.75)
