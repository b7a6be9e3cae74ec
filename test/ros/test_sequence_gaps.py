"""Gaps between numbered messages are counted exactly."""

from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.ros.endpoints import SequenceGaps


@given(st.integers(1, 10**12), st.sets(st.integers(1, 200)))
def test_gaps_of_one_publisher_are_counted_exactly(first, lost):
    gaps = SequenceGaps(lambda: 1)
    arrived = [number for number in range(202) if number not in lost]
    for number in arrived:
        gaps.record(first + number)
    assert gaps.missing == len(lost)


@given(
    st.lists(st.integers(0, 2), max_size=200), st.tuples(*[st.integers(1, 10**6) for _ in range(3)])
)
def test_several_publishers_that_lose_nothing_have_no_gaps(order, firsts):
    # Sequences of different publishers do not touch each other here, as they hardly ever do.
    following = [first + place * 10**7 for place, first in enumerate(firsts)]
    gaps = SequenceGaps(lambda: 3)
    for publisher in order:
        gaps.record(following[publisher])
        following[publisher] += 1
    assert gaps.missing == 0


@given(st.lists(st.integers(1, 10**6), min_size=1))
def test_what_new_publishers_sent_before_they_were_heard_is_missing(firsts):
    gaps = SequenceGaps(lambda: 1)
    gaps.from_first = True
    for first in sorted({2 * first for first in firsts}, reverse=True):  # none continues another
        gaps.record(first)
    assert gaps.missing == sum(2 * first - 1 for first in set(firsts))
