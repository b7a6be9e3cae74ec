"""Values: sequences of different lengths in one array, and arrays as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.foundation.json_text import finite_values, json_text, name_of
from rpud_sim.foundation.quantities import ExpectedError


@dataclass(frozen=True)
class Sequences:
    """Sequences of numbers, one behind the other."""

    values: np.ndarray  # values of all sequences, shape (m,)
    # number of the first value of each sequence, and of all, shape (n + 1,), int64
    cuts: np.ndarray

    @classmethod
    def of(cls, rows: Iterable[np.ndarray], dtype: np.dtype) -> Sequences:
        parts = [part.astype(dtype, copy=False) for part in rows]
        counts = np.array([len(part) for part in parts], np.int64)
        return cls.of_counts(np.concatenate([np.empty(0, dtype), *parts]), counts)

    @classmethod
    def of_counts(cls, values: np.ndarray, counts: np.ndarray) -> Sequences:
        return cls(values, np.concatenate([[0], np.cumsum(counts)]))

    def __len__(self) -> int:
        return len(self.cuts) - 1

    @cached_property
    def counts(self) -> np.ndarray:
        return np.diff(self.cuts)

    def sequence(self, number: int) -> np.ndarray:
        """Return one sequence, in the same memory."""
        return self.values[self.cuts[number] : self.cuts[number + 1]]

    def rows(self) -> list[np.ndarray]:
        cuts = self.cuts.tolist()
        return [self.values[start:end] for start, end in pairwise(cuts)]


def to_float32(values: Any) -> np.ndarray:
    """Return numbers in 32 bits; a damaged one beyond their range is infinite, without warning."""
    with np.errstate(over="ignore"):
        return np.asarray(values).astype(np.float32)


# Elements of an array that become JSON together
_MOST_ELEMENTS = 65_536


def to_json(value: Any) -> str:
    """Return a value as one line of JSON; NaN and infinity, which JSON lacks, are texts."""
    if isinstance(value, np.ndarray) and value.size > _MOST_ELEMENTS:
        # One list of everything would take many times the memory of the array.
        parts = (
            to_json(value[at : at + _MOST_ELEMENTS])[1:-1]
            for at in range(0, len(value), _MOST_ELEMENTS)
        )
        return f"[{', '.join(parts)}]"
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    try:
        return json_text(plain, ensure_ascii=False)
    except ExpectedError:
        return json_text(finite_values(plain, name_of), ensure_ascii=False)
