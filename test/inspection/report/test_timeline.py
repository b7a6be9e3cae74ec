"""Stamps become times since the bag began, wherever their clock is set."""

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.report.timeline import Timeline


def test_times_go_on_where_the_clock_is_set():
    timeline = Timeline(1000 * SECOND)
    stamps = np.array([5, 6, 7, 0, 1, 2]) * SECOND  # a reset after 7 s
    logs = (1000 + np.array([1, 2, 3, 4, 5, 6])) * SECOND
    times = np.append(
        timeline.elapsed(stamps[:2], logs[:2]), timeline.elapsed(stamps[2:], logs[2:])
    )
    assert times.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert timeline.jumps == 1


def test_faster_than_real_time_is_no_jump_and_an_unset_stamp_is_one():
    timeline = Timeline(0)
    stamps = np.arange(5) * 10 * SECOND
    assert timeline.elapsed(stamps, np.arange(5) * SECOND).tolist() == [0.0, 10.0, 20.0, 30.0, 40.0]
    assert timeline.jumps == 0
    epoch = 1_700_000_000 * SECOND
    times = timeline.elapsed(np.array([epoch, epoch + SECOND]), np.array([5, 6]) * SECOND)
    assert times.tolist() == [41.0, 42.0]
    assert timeline.jumps == 1


def test_rows_of_a_block_end_when_it_was_recorded():
    timeline = Timeline(0)
    stamps = np.arange(1, 9) * SECOND
    logs = np.repeat([4, 8], 4) * SECOND
    assert timeline.elapsed(stamps, logs).tolist() == list(range(1, 9))
    assert Timeline(0).elapsed(np.zeros(0, int), np.zeros(0, int)).tolist() == []


def test_clocks_of_one_namespace_have_one_zero_whatever_is_older_than_the_bag():
    begin, stamp = 1000 * SECOND, 50 * SECOND
    latched = Timeline(begin, stamp, latched=True)
    stamps = stamp + np.array([-5, 1, 2]) * SECOND  # the first was kept since before the bag
    logs = begin + np.array([0, 1, 2]) * SECOND
    assert latched.elapsed(stamps, logs).tolist() == [-5.0, 1.0, 2.0]
    assert latched.jumps == 0
    late = Timeline(begin, stamp)
    assert late.elapsed(stamps[1:] - SECOND // 2, logs[1:]).tolist() == [0.5, 1.5]
    other = Timeline(begin, stamp)  # a clock of its own
    assert other.elapsed(np.array([0, 1]) * SECOND, logs[1:]).tolist() == [1.0, 2.0]
