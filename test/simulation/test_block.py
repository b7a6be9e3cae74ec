"""Blocks that follow each other have everything once, and joined they are the one they are of."""

import dataclasses
from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.model.energy import RpudConstants
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.block import Block, boundaries_until, boundary, join_blocks
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
END = SECOND // 5
rates = st.integers(1, 1_000_000)
EMPTY = np.empty(0)
RPUD = RpudConstants(1.0, False, 0.0)


def blocks_until(times):
    simulation = Simulation(Parameters())
    return [simulation.advance_to(time) for time in times]


@given(st.integers(0, 10**7), rates)
def test_a_boundary_is_the_last_one_at_its_own_time(number, rate):
    time = boundary(number, rate)
    assert 0 <= number * SECOND - time * rate < rate  # rounded down to a nanosecond
    assert boundaries_until(time, rate) == number
    assert boundaries_until(boundary(number + 1, rate) - 1, rate) == number


@given(rates, st.lists(st.integers(0, 3 * SECOND), min_size=2).map(sorted))
def test_blocks_that_follow_each_other_have_every_sample_once(rate, times):
    def grid(start, end):
        return Block(start, np.array([end]), *[EMPTY] * 4, RPUD, 0.0).grid(rate)

    grids = [grid(start, end) for start, end in pairwise(times)]
    whole = grid(times[0], times[-1])
    assert sum(map(len, grids)) == len(whole)
    for before, after in pairwise([grid for grid in grids if grid]):
        assert before.stop == after.start
    for number in (*whole[:2], *whole[-2:]):
        assert times[0] * rate <= number * SECOND < times[-1] * rate


@given(st.sets(st.integers(1, END - 1), max_size=6))
def test_joined_blocks_are_the_whole(times):
    joined = join_blocks(blocks_until([*sorted(times), END]))
    [whole] = blocks_until([END])
    assert (joined.start, joined.end) == (0, END)
    assert (joined.segments == whole.segments).all()
    assert (joined.open_segment == whole.open_segment).all()
    assert (joined.impacts == whole.impacts).all()
    moments = Times.from_grid(0, 50, 250)
    for name, values in dataclasses.asdict(joined.sample(moments)).items():
        assert (values == getattr(whole.sample(moments), name)).all(), name
