"""Times are joined from seconds and nanoseconds, and split into fractions, without loss."""

from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.time import SECOND, join_seconds, split_fraction


@given(st.integers())
def test_a_time_is_joined_from_seconds_and_nanoseconds_without_loss(nanoseconds):
    assert join_seconds(*divmod(nanoseconds, SECOND)) == nanoseconds


def test_a_fraction_is_the_rest_of_the_second():
    assert split_fraction(2_250_000_000) == (2, 0.25)
    assert split_fraction(-250_000_000) == (-1, 0.75)
