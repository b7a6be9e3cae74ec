"""What happened between two times, as every consumer takes it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.records import join
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.simulation.sampling import Samples, Times, sample


def boundary(number: int, rate: int) -> int:
    """Simulation time at which a block of 1 / rate ends [ns], exact for any whole rate [Hz]."""
    return number * SECOND // rate


def boundaries_until(time: int, rate: int) -> int:
    """Number of the last block boundary at or before a simulation time [ns]."""
    return ((time + 1) * rate - 1) // SECOND


@dataclasses.dataclass(frozen=True)
class Block:
    """What happened between two times, immutable.

    Times are integer nanoseconds of simulation time.

    Args:
        start: beginning of the block.
        end: its end.
        covering: the ``SEGMENT`` records that cover the block, in order, without a gap. The last
            one is open: its duration is what it will be unless a command comes.
        impacts: the ``IMPACT`` records of the impacts on the drill tool that ended in it, in order.
    """

    start: int
    end: int
    covering: np.ndarray
    impacts: np.ndarray

    @property
    def segments(self) -> np.ndarray:
        """The segments that ended in the block."""
        return self.covering[:-1]

    @property
    def open_segment(self) -> np.ndarray:
        """The segment that was in progress at its end, shape (1,)."""
        return self.covering[-1:]

    def grid(self, rate: int) -> range:
        """Numbers of the samples at a whole rate [Hz] from the block's start on and before its end.

        Blocks that follow each other have every sample once.
        """
        return range(
            -(-self.start * rate // SECOND),
            -(-self.end * rate // SECOND),
        )

    def sample(self, times: Times) -> Samples:
        """Sample all channels at ascending times from the block's start to its end."""
        return sample(self.covering, times)


def join_blocks(blocks: Sequence[Block]) -> Block:
    """Return one block for at least one that follow each other."""
    last = blocks[-1]
    return Block(
        blocks[0].start,
        last.end,
        join([*(block.segments for block in blocks), last.open_segment], SEGMENT),
        join([block.impacts for block in blocks], IMPACT),
    )
