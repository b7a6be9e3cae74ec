"""Commands that stay out let the drill go down to nothing, as fast as the ramp says."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.simulation.watchdog import CommandWatchdog

SECOND = 1_000_000_000
times = st.integers(0, 100 * SECOND)
timeouts = st.floats(1e-3, 10.0)
ramps = st.floats(0.0, 10.0)


def test_the_share_goes_down_linearly_after_the_timeout():
    watchdog = CommandWatchdog(0.5, 2.0, 3 * SECOND)
    shares = [watchdog.share(3 * SECOND + half * SECOND // 2) for half in range(8)]
    assert shares == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0]
    assert not watchdog.lost(3 * SECOND + SECOND // 2)
    assert watchdog.lost(3 * SECOND + SECOND // 2 + 1)


def test_any_command_brings_everything_back():
    watchdog = CommandWatchdog(0.5, 2.0)
    assert watchdog.share(2 * SECOND) < 1.0
    watchdog.reset(2 * SECOND)
    assert watchdog.share(2 * SECOND) == watchdog.share(2 * SECOND + SECOND // 2) == 1.0
    assert not watchdog.lost(2 * SECOND)


@given(times)
def test_without_a_timeout_commands_are_never_lost(time):
    watchdog = CommandWatchdog(0.0, 0.5)
    assert watchdog.share(time) == 1.0
    assert not watchdog.lost(time)


def test_without_a_ramp_there_is_nothing_at_once():
    watchdog = CommandWatchdog(0.5, 0.0)
    assert watchdog.share(SECOND // 2) == 1.0
    assert watchdog.share(SECOND // 2 + 1) == 0.0


@given(timeouts, ramps, times, st.lists(times, min_size=2, unique=True).map(sorted))
def test_the_share_only_falls_from_one_to_nothing(timeout, ramp, last, moments):
    watchdog = CommandWatchdog(timeout, ramp)
    watchdog.reset(last)
    shares = [watchdog.share(last + moment) for moment in moments]
    assert shares == sorted(shares, reverse=True)
    assert all(0.0 <= share <= 1.0 for share in shares)
    for moment, share in zip(moments, shares, strict=True):
        assert watchdog.lost(last + moment) or share == 1.0
        if moment / SECOND > (timeout + ramp) * (1.0 + 1e-9):
            assert share == 0.0


def test_the_shortest_timeout_is_one():
    assert CommandWatchdog(1e-15, 0.0).lost(2)


def test_another_timeout_and_ramp_hold_from_now_on():
    watchdog = CommandWatchdog(0.0, 0.0)
    watchdog.set(1.0, 1.0)
    assert watchdog.share(3 * SECOND // 2) == 0.5
    watchdog.set(0.0, 1.0)
    assert watchdog.share(3 * SECOND // 2) == pytest.approx(1.0)
