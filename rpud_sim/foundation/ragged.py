"""Sequences of different lengths in one array."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Ragged:
    """Sequences of numbers, one behind the other."""

    values: np.ndarray  # of all sequences, shape (m,)
    # number of the first value of each sequence, and of all, shape (n + 1,), int64
    cuts: np.ndarray

    def __len__(self) -> int:
        """Return the number of sequences."""
        return len(self.cuts) - 1

    @cached_property
    def counts(self) -> np.ndarray:
        """Numbers in each sequence."""
        return np.diff(self.cuts)

    def sequence(self, number: int) -> np.ndarray:
        """Return one sequence, in the same memory."""
        return self.values[self.cuts[number] : self.cuts[number + 1]]
