"""Blocks: what happened between two times, in one part or in many, and their boundaries."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from rpud_sim.drilling.process import AT_REST, ProcessState
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.energy import RpudConstants
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.energy_account import FeedAccount, sum_accounts
from rpud_sim.simulation.sampling import Samples, Times, sample, sample_parts


def boundary(number: int, rate: int) -> int:
    """Return the simulation time at which a block ends [ns]; the rate [Hz] is whole."""
    return number * SECOND // rate


def boundaries_until(time: int, rate: int) -> int:
    """Return the number of the last block boundary at or before a simulation time [ns]."""
    return ((time + 1) * rate - 1) // SECOND


def first_sample(time: int, rate: int) -> int:
    """Return the number of the first sample at or after a simulation time [ns], at a rate [Hz]."""
    return -(-time * rate // SECOND)


@dataclasses.dataclass(frozen=True)
class Block:
    """Segments and impacts between two times, immutable; it may be many blocks in one.

    Times are integer nanoseconds of simulation time.
    """

    start: int  # beginning of the first part
    ends: np.ndarray  # end of each part, at least one, shape (n,), int64
    # the ``SEGMENT`` records that cover the block, in order, without a gap. The last one is
    # open: it has its full duration, which a command may shorten.
    covering: np.ndarray
    # the ``IMPACT`` records of the impacts on the drill tool that ended in it, in order
    impacts: np.ndarray
    # number of the segments that were finished at each end, shape (n,), int64. The next one
    # was open there.
    finished: np.ndarray
    struck: np.ndarray  # number of the impacts that were finished at each end, shape (n,), int64
    rpud: RpudConstants  # constants of the RPUD that the segments lack
    electrical_energy: float  # drawn by the actuator in it [J]; NaN where its model has no power
    readings: Sequence[ActuatorReading] = ()  # readings of the actuator at each end
    # states of rotation, feed and borehole at each end; none where there is nothing to step
    states: Sequence[ProcessState] = ()
    feeds: Sequence[FeedAccount] = ()  # account of feed and mount in each part; none without a feed
    depth: float = math.nan  # depth of the hole at its end [m]; NaN without strata and a rock model

    def __len__(self) -> int:
        return len(self.ends)

    @property
    def end(self) -> int:
        return int(self.ends[-1])

    @property
    def starts(self) -> np.ndarray:
        return _shifted(self.start, self.ends)

    @property
    def opened(self) -> np.ndarray:
        """Number of the segment that was open when each part began."""
        return _shifted(0, self.finished)

    @property
    def actuator(self) -> ActuatorReading | None:
        return self.readings[-1] if self.readings else None

    @property
    def process(self) -> ProcessState:
        """State of rotation, feed and borehole at the end."""
        return self.states[-1] if self.states else AT_REST

    @property
    def feed(self) -> FeedAccount | None:
        """Energy account of feed and mount in the block; None without a feed."""
        return sum_accounts(self.feeds)

    @property
    def segments(self) -> np.ndarray:
        """The segments that ended in the block."""
        return self.covering[:-1]

    @property
    def open_segment(self) -> np.ndarray:
        """The segment that was in progress at its end, shape (1,)."""
        return self.covering[-1:]

    def grid(self, rate: int) -> range:
        """Return the numbers of the samples at a whole rate [Hz], from start on and before end.

        Consecutive blocks have every sample once.
        """
        return range(first_sample(self.start, rate), first_sample(self.end, rate))

    def sample(self, times: Times) -> Samples:
        """Sample all channels at ascending times from the block's start to its end."""
        return sample(self.covering, times)

    def sample_ends(self) -> Samples:
        """Sample all channels at the end of each part."""
        parts = (self.opened, self.finished, np.arange(len(self) + 1))
        return sample_parts(self.covering, *parts, Times.from_nanoseconds(self.ends))

    def sample_parts(self, length: int, cuts: np.ndarray, times: Times) -> Samples:
        """Sample all channels in groups of ``length`` parts, as if each were alone.

        ``cuts`` are the number of the first of the ascending times of each group, and of all.
        """
        groups = (self.opened[::length], self.finished[length - 1 :: length], cuts)
        return sample_parts(self.covering, *groups, times)


def join_blocks(blocks: Sequence[Block]) -> Block:
    """Return consecutive blocks, at least one, as one block with the parts of all."""
    if len(blocks) == 1:
        return blocks[0]
    last = blocks[-1]
    segments = list(accumulate((len(block.segments) for block in blocks), initial=0))
    impacts = list(accumulate((len(block.impacts) for block in blocks), initial=0))
    return Block(
        blocks[0].start,
        np.concatenate([block.ends for block in blocks]),
        join_records([*(block.segments for block in blocks), last.open_segment], SEGMENT),
        join_records([block.impacts for block in blocks], IMPACT),
        np.concatenate([block.finished + segments[n] for n, block in enumerate(blocks)]),
        np.concatenate([block.struck + impacts[n] for n, block in enumerate(blocks)]),
        last.rpud,
        math.fsum(block.electrical_energy for block in blocks),
        [reading for block in blocks for reading in block.readings],
        [state for block in blocks for state in block.states],
        [feed for block in blocks for feed in block.feeds],
        last.depth,
    )


def _shifted(first: int, values: np.ndarray) -> np.ndarray:
    """Return a first value and all others but the last; each live block needs it."""
    shifted = np.empty_like(values)
    shifted[0] = first
    shifted[1:] = values[:-1]
    return shifted
