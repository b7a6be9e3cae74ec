"""Times are split into seconds and nanoseconds and joined again without loss."""

from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.time import SECOND, join_seconds, split_fraction, split_seconds


@given(st.integers())
def test_a_time_is_split_and_joined_without_loss(nanoseconds):
    seconds, rest = split_seconds(nanoseconds)
    assert 0 <= rest < SECOND
    assert join_seconds(seconds, rest) == nanoseconds
    assert split_fraction(nanoseconds) == (seconds, rest / SECOND)
