"""Times of the screen by the origins of a journal: through pauses, resets and checkpoints."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rpud_sim.recorded.run_clock import RunClock

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
spans = st.lists(
    st.tuples(
        st.sampled_from(["pause", "begin", "stamps", "restore"]),
        st.integers(1, 10 * SECOND),  # of simulation time
        st.integers(0, 100 * SECOND),  # of real time, in which the drill stands
    ),
    max_size=8,
)


@example([("stamps", SECOND, 0), ("stamps", SECOND, 0)])  # to stamp zero, twice
@given(spans)
def test_time_goes_on_as_that_of_the_simulation(changes):
    clock, origin, now, published, passed = RunClock(START), START, 0, START, 0
    clock.add("begin", START, 0, published)
    told, expected = [], []
    for kind, length, stands in changes:
        for part in (0, length // 2, length):
            told.append((origin + now + part, published + part))
            expected.append(passed + part)
        now, published, passed = now + length, published + length, passed + length
        clock.add("flush", origin + now, now, published)
        published += stands
        if kind == "restore":
            clock.add(kind, origin + now, now, published)
        if kind == "pause":
            origin += stands
        elif kind == "stamps":
            origin = -now
        else:
            now, origin = (0 if kind == "begin" else now // 3), published
        published += 1
        clock.add("begin" if kind == "begin" else "origin", origin + now, now, published)
    stamps, times = np.array(told, np.int64).reshape(-1, 2).T
    assert (clock.elapsed(stamps, times) * SECOND).round() == pytest.approx(expected, abs=1)


def test_a_message_after_a_pause_may_come_before_its_origin():
    clock = RunClock(START)
    clock.add("begin", START, 0, START)
    resumed = START + 61 * SECOND
    assert clock.add("origin", resumed, SECOND, resumed + 5)
    assert clock.seconds(resumed + 1000, resumed + 1) == pytest.approx(1.000001)
    assert clock.seconds(START + SECOND // 2, START) == 0.5


@pytest.mark.parametrize("time", [None, "1", 1.5, 2**62, -(2**70)])
def test_an_entry_of_another_program_changes_nothing(time):
    clock = RunClock(START)
    assert not clock.add("begin", START + SECOND, time, START)
    assert clock.seconds(START + SECOND) == 1.0
