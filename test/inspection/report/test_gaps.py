"""Gaps are where a sequence skips, or where a series pauses, and overlapping ones are one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.report import gaps
from rpud_sim.inspection.report.gaps import Gap, Gaps, merged, pauses


@given(st.lists(st.integers(0, 3), min_size=1, max_size=50), st.integers(1, 10))
def test_a_gap_lies_between_its_neighbours_and_counts_what_is_missing(skips, size):
    numbers = np.cumsum([1 + skip for skip in skips])
    times = numbers * 0.1
    found = Gaps()
    for start in range(0, len(numbers), size):
        found.add(numbers[start : start + size], times[start : start + size])
    assert found.missing == sum(skips[1:])
    assert [gap.missing for gap in found.found] == [skip for skip in skips[1:] if skip]
    for gap in found.found:
        assert gap.end - gap.begin > 0.1


def test_further_gaps_are_counted(monkeypatch):
    monkeypatch.setattr(gaps, "MOST_GAPS", 2)
    found = Gaps()
    found.add(np.arange(0, 10, 2), np.arange(5.0))
    assert (len(found.found), found.unlisted, found.missing) == (2, 2, 4)


def test_a_sequence_that_begins_again_is_no_gap():
    found = Gaps()
    found.add(np.array([7, 8, 0, 1]), np.arange(4.0))
    assert found.found == []


def test_pauses_are_where_a_series_is_nan():
    times = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    values = np.array([1.0, 1.0, np.nan, 1.0, np.nan])
    assert pauses(times, values) == [Gap(2.0, 5.0)]


def test_overlapping_gaps_are_one_with_all_names():
    found = merged(
        [("b", Gap(2.0, 4.0)), ("a", Gap(1.0, 3.0)), ("c", Gap(8.0, 9.0)), ("a", Gap(3.5, 5.0))]
    )
    assert found == [(1.0, 5.0, ("a", "b")), (8.0, 9.0, ("c",))]
