"""Spans: many consecutive blocks in one, for work on all of them at once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from rpud_sim.drilling.process import AT_REST, ProcessState
from rpud_sim.foundation.shared import Shared
from rpud_sim.model.energy import RpudConstants
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.block import Block, join_blocks, sum_accounts
from rpud_sim.simulation.feed_account import FeedAccount
from rpud_sim.simulation.sampling import Samples, Stretches, Times, sample_stretches


@dataclasses.dataclass(frozen=True)
class Span(Shared):
    """Consecutive blocks, at least one, immutable. Times are nanoseconds of simulation time."""

    start: int  # beginning of the first block
    ends: np.ndarray  # end of each block, shape (n,), int64
    # the ``SEGMENT`` records that cover all blocks, as those of a ``Block`` do
    covering: np.ndarray
    impacts: np.ndarray  # the ``IMPACT`` records of all blocks
    # number of the segments that were finished at each end, shape (n,), int64. The next one
    # was open there.
    finished: np.ndarray
    struck: np.ndarray  # number of the impacts that were finished at each end, shape (n,), int64
    rpud: RpudConstants  # constants of the RPUD that the segments lack
    electrical_energy: float  # that the actuator drew in them [J]; NaN where its model has no power
    readings: Sequence[ActuatorReading]  # of the actuator at each end
    # of rotation, feed and borehole at each end; none where there is nothing to step
    states: Sequence[ProcessState] = ()
    # energy account of feed and mount in each block; none without a feed
    feeds: Sequence[FeedAccount] = ()

    def __len__(self) -> int:
        """Return the number of blocks."""
        return len(self.ends)

    @property
    def end(self) -> int:
        """End of the last block."""
        return int(self.ends[-1])

    @property
    def starts(self) -> np.ndarray:
        """Beginning of each block."""
        return _shifted(self.start, self.ends)

    @property
    def opened(self) -> np.ndarray:
        """Number of the segment that was open when each block began."""
        return _shifted(0, self.finished)

    @property
    def block(self) -> Block:
        """All blocks as one."""
        return Block(
            self.start,
            self.end,
            self.covering,
            self.impacts,
            self.rpud,
            self.electrical_energy,
            self.readings[-1] if self.readings else None,
            self.states[-1] if self.states else AT_REST,
            sum_accounts(self.feeds),
        )

    def sample_ends(self) -> Samples:
        """Sample all channels at the end of each block."""
        parts = Stretches(self.opened, self.finished, np.arange(len(self) + 1))
        return sample_stretches(self.covering, parts, Times.from_nanoseconds(self.ends))

    def sample_parts(self, length: int, cuts: np.ndarray, times: Times) -> Samples:
        """Sample all channels in parts of ``length`` blocks, as their joined blocks would do.

        Args:
            length: of a part; the blocks are a whole multiple of it.
            cuts: number of the first time of each part, and of all.
            times: ascending, each from the beginning of its part to its end.
        """
        parts = Stretches(self.opened[::length], self.finished[length - 1 :: length], cuts)
        return sample_stretches(self.covering, parts, times)


def span_of(blocks: Sequence[Block]) -> Span:
    """Return consecutive blocks, at least one, as a span."""
    joined = join_blocks(blocks)
    readings = [block.actuator for block in blocks if block.actuator is not None]
    return Span(
        joined.start,
        np.array([block.end for block in blocks], np.int64),
        joined.covering,
        joined.impacts,
        np.array([*accumulate(len(block.segments) for block in blocks)], np.int64),
        np.array([*accumulate(len(block.impacts) for block in blocks)], np.int64),
        joined.rpud,
        joined.electrical_energy,
        readings,
        [block.process for block in blocks],
        [block.feed for block in blocks if block.feed is not None],
    )


def _shifted(first: int, values: np.ndarray) -> np.ndarray:
    """Return a first value and all others but the last; each live block needs it at once."""
    shifted = np.empty_like(values)
    shifted[0] = first
    shifted[1:] = values[:-1]
    return shifted
