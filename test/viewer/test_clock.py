"""Clocks of a bag: the same times as the report's, in any order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.recorded_drill import Clock, Jump
from rpud_sim.viewer.signals import find_jumps

SECOND = 1_000_000_000
STEPS = st.lists(
    st.tuples(st.integers(0, 5 * SECOND), st.integers(-200 * SECOND, 200 * SECOND)), max_size=30
)


@given(STEPS, st.integers(0, 10**18))
def test_time_passes_as_the_stamps_do_except_at_jumps(steps, first):
    logs = first + np.cumsum([0, *(1 + passed for passed, _ in steps)])
    stamps = first + np.cumsum([0, *(step for _, step in steps)])
    jumps = find_jumps(stamps, logs)
    elapsed = Clock(int(stamps[0]), int(logs[0]), tuple(jumps)).elapsed(stamps, logs)
    at = {jump.time for jump in jumps}
    for place, (passed, step) in enumerate(steps, 1):
        expected = 1 + passed if int(logs[place]) in at else step
        assert elapsed[place] - elapsed[place - 1] == pytest.approx(expected / SECOND, abs=1e-6)


def test_a_topic_without_stamps_goes_by_the_log_times():
    clock = Clock(None, 5 * SECOND)
    assert clock.elapsed(np.array([0]), np.array([7 * SECOND])).tolist() == [2.0]


@pytest.mark.parametrize("far", [2**63, -(2**63) - 1])
def test_times_beyond_int64_are_no_error(far):
    stamps = np.array([3 * SECOND])
    for clock in (Clock(None, far), Clock(far, 0), Clock(far, 0, (Jump(1, 1),))):
        assert clock.elapsed(stamps, stamps) == pytest.approx([-far / SECOND])
