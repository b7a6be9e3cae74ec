"""Of many commands of a feed those that change it clearly, and for longer, begin segments."""

import math

import pytest

from rpud_sim.inspection.report.feed_changes import FeedChanges, FeedCommand, Step


def rate(value):
    return FeedCommand("rate", value)


def position(value):
    return FeedCommand("position", value)


def begun(commands):
    """Give the times at which segments begin that stay."""
    changes = FeedChanges()
    changes.begin(known=True)
    times = []
    for time, feed in commands:
        step = changes.take(time, feed)
        if step is Step.BEGINS:
            times.append(time)
        elif step is Step.COMES_BACK:
            times.pop()
    return times


def streamed(value_at, seconds, start=0.0):
    """Give a stream of 100 Hz."""
    times = [start + number / 100 for number in range(round(100 * seconds))]
    return [(time, value_at(time)) for time in times]


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        (rate(1e-3), rate(1.9e-3), True),
        (rate(1e-3), rate(2.1e-3), False),
        (rate(1e-3), rate(-1e-3), False),
        (rate(0.0), rate(1e-9), False),
        (rate(-1e-3), rate(-1.5e-3), True),
        (rate(0.0), rate(0.0), True),
        (rate(0.0), position(0.0), False),
        (position(0.01), position(0.0109), True),
        (position(0.01), position(0.0111), False),
    ],
)
def test_a_clear_change_is_of_mode_sign_or_size(one, other, alike):
    assert one.is_like(other) is other.is_like(one) is alike


def test_a_controller_at_100_hz_whose_rate_oscillates_makes_no_more_than_one_segment():
    seek = streamed(lambda time: rate(1e-3), 5.0)
    # 0.1 mm/s on the average, of either sign.
    hold = streamed(lambda time: rate(1e-4 + 3e-4 * math.sin(40.0 * time)), 60.0, 5.0)
    retract = streamed(lambda time: rate(-2e-3), 5.0, 65.0)
    times = begun([*seek, *hold, *retract])
    assert times[:2] == [0.0, 5.0]
    assert times[-1] == pytest.approx(65.0, abs=1.0)
    assert len(times) <= 2 + 60 + 1
    steady = streamed(lambda time: rate(1e-4 * (1.0 + 0.4 * math.sin(40.0 * time))), 60.0, 5.0)
    assert begun([*seek, *steady, *retract]) == [0.0, 5.0, 65.0]


def test_targets_in_small_steps_make_a_segment_each_second_at_most():
    # 5 mm/s as positions.
    times = begun(streamed(lambda time: position(5e-3 * time), 10.0))
    assert len(times) == pytest.approx(10, abs=1)
