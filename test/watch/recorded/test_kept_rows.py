"""Rows that are kept: the latest ones, within a limit of parts and of numbers."""

import numpy as np

from rpud_sim.watch.recorded.kept_rows import KeptRows
from rpud_sim.watch.recorded.signals import Rows


def part(count):
    """Rows of a part with so many messages, which need no memory."""
    times = np.broadcast_to(np.int64(0), (count,))
    return {"/a": Rows(times, times, {"x": times})}


def test_of_many_parts_those_are_kept_that_were_used_last():
    kept = KeptRows()
    first = part(1)
    kept.add(0, first)
    for number in range(1, 200):
        kept.add(number, part(1))
    assert kept.find(0) is first
    kept.add(200, part(1))
    assert [number for number in range(201) if kept.find(number) is None] == [1]


def test_of_large_parts_fewer_are_kept_and_the_latest_always_is():
    kept = KeptRows()
    for number in range(3):
        kept.add(number, part(600_000))
    assert [number for number in range(3) if kept.find(number) is not None] == [1, 2]
    kept.add(3, part(10_000_000))
    assert [number for number in range(4) if kept.find(number) is not None] == [3]
