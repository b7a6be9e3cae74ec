"""Sequences of different lengths in one array."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Ragged:
    """Sequences of numbers, one behind the other."""

    values: np.ndarray  # of all sequences, shape (m,)
    # number of the first value of each sequence, and of all, shape (n + 1,), int64
    cuts: np.ndarray

    @classmethod
    def of(cls, rows: Iterable[np.ndarray], dtype: np.dtype) -> Ragged:
        parts = [part.astype(dtype, copy=False) for part in rows]
        counts = np.array([len(part) for part in parts], np.int64)
        return cls.of_counts(np.concatenate([np.empty(0, dtype), *parts]), counts)

    @classmethod
    def of_counts(cls, values: np.ndarray, counts: np.ndarray) -> Ragged:
        return cls(values, np.concatenate([[0], np.cumsum(counts)]))

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

    def rows(self) -> list[np.ndarray]:
        """Return all sequences, in the same memory."""
        cuts = self.cuts.tolist()
        return [self.values[start:end] for start, end in pairwise(cuts)]
