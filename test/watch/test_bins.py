"""Rows with a bounded length, compared with a plain dictionary."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.watch.bins import Rows

LENGTH = 7


@given(st.lists(st.integers(0, 60), max_size=60))
def test_the_last_rows_are_kept_whatever_the_order_of_writing(numbers):
    rows, written, end = Rows(1, LENGTH), {}, 0
    for value, number in enumerate(numbers):
        row = rows.row(number)
        end = max(end, number + 1)
        if row is not None:
            row[0] = written[number] = value
    shown = rows.snapshot()
    assert rows.end == end
    assert len(shown) == end - rows.first <= LENGTH
    for number, row in zip(range(rows.first, rows.end), shown, strict=True):
        assert row[0] == written[number] if number in written else np.isnan(row[0])


def test_a_snapshot_does_not_change_and_cannot_be_changed():
    rows = Rows(2, LENGTH)
    rows.row(0)[:] = 1.0
    shown = rows.snapshot()
    rows.row(0)[:] = 2.0
    assert shown.tolist() == [[1.0, 1.0]]
    assert not shown.flags.writeable
