"""Missing: how many messages of a topic are missing, and where they may have been."""

from __future__ import annotations

import dataclasses

import numpy as np

from rpud_sim.foundation.time import NEVER


@dataclasses.dataclass(frozen=True)
class Missing:
    """Numbers of messages that are missing, each in a stretch of time."""

    first: np.ndarray  # of each stretch, in order [ns]
    last: np.ndarray  # of each stretch, in order [ns]
    counts: np.ndarray  # of the messages that are missing in each
    anywhere: int = 0  # number of further messages, at times that are not known

    @classmethod
    def from_numbers(cls, stamps: np.ndarray, numbers: np.ndarray) -> Missing:
        """Return what the numbers in the messages of a topic show as missing.

        Each number is one more than that of the message before; stamps are in order [ns].
        """
        counts = np.concatenate([numbers[:1], np.maximum(np.diff(numbers) - 1, 0)])
        before = np.concatenate([[-NEVER], stamps[:-1]])[: len(stamps)]
        some = counts > 0
        return cls(before[some], stamps[some], counts[some])

    @classmethod
    def none(cls) -> Missing:
        """Return that no message is missing."""
        empty = np.empty(0, np.int64)
        return cls(empty, empty, empty)

    @property
    def total(self) -> int:
        return int(self.counts.sum()) + self.anywhere

    def among(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Return the greatest number of messages missing in each of some spans of time [ns]."""
        sums = np.concatenate([[0], np.cumsum(self.counts)])
        begun = sums[np.searchsorted(self.first, last, side="right")]
        ended = sums[np.searchsorted(self.last, first, side="left")]
        return np.maximum(begun - ended, 0) + self.anywhere
