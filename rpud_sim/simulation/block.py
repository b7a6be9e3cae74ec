"""Blocks: what happened between two times, and their boundaries."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np

from rpud_sim.drilling.process import AT_REST, ProcessState
from rpud_sim.foundation.shared import Shared
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.energy import RpudConstants
from rpud_sim.model.segment import IMPACT, SEGMENT, join_records
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.feed_account import FeedAccount
from rpud_sim.simulation.sampling import Samples, Times, sample


def boundary(number: int, rate: int) -> int:
    """Return the simulation time at which a block ends [ns], exact for any whole rate [Hz]."""
    return number * SECOND // rate


def boundaries_until(time: int, rate: int) -> int:
    """Return the number of the last block boundary at or before a simulation time [ns]."""
    return ((time + 1) * rate - 1) // SECOND


def first_sample(time: int, rate: int) -> int:
    """Return the number of the first sample at or after a simulation time [ns], at a rate [Hz]."""
    return -(-time * rate // SECOND)


@dataclasses.dataclass(frozen=True)
class Block(Shared):
    """Segments and impacts between two times, immutable.

    Times are integer nanoseconds of simulation time.
    """

    start: int  # beginning of the block
    end: int  # its end
    # the ``SEGMENT`` records that cover the block, in order, without a gap. The last one is
    # open: it has its full duration, which a command may shorten.
    covering: np.ndarray
    # the ``IMPACT`` records of the impacts on the drill tool that ended in it, in order
    impacts: np.ndarray
    rpud: RpudConstants  # constants of the RPUD that the segments lack
    electrical_energy: float  # that the actuator drew in it [J]; NaN where its model has no power
    actuator: ActuatorReading | None = None  # its state at the end of the block
    process: ProcessState = AT_REST  # state of rotation, feed and borehole at the end of the block
    # energy account of feed and mount in the block; None without a feed
    feed: FeedAccount | None = None

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


def sum_accounts(accounts: Iterable[FeedAccount | None]) -> FeedAccount | None:
    """Return the sum of accounts; None if there are none."""
    there = [account for account in accounts if account is not None]
    return sum(there[1:], there[0]) if there else None


def join_blocks(blocks: Sequence[Block]) -> Block:
    """Return consecutive blocks, at least one, as one block."""
    last = blocks[-1]
    if len(blocks) == 1:
        return last
    return Block(
        blocks[0].start,
        last.end,
        join_records([*(block.segments for block in blocks), last.open_segment], SEGMENT),
        join_records([block.impacts for block in blocks], IMPACT),
        last.rpud,
        math.fsum(block.electrical_energy for block in blocks),
        last.actuator,
        last.process,
        sum_accounts(block.feed for block in blocks),
    )
