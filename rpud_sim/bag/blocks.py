"""Tables of messages that hold many samples or segments, with one row for each of these."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from rpud_sim.bag.columns import Column, Kind, Sequences
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.foundation.time import SECOND

# Column with the exact time of each row.
TIME = Column("time", Kind.TIME, np.dtype(np.int64), description="of the sample or segment")

# Columns from which the time of a row is calculated, by type.
_TIME_COLUMNS = {
    "rpud_msgs/msg/Trajectory": {"origin", "sequence", "start_seconds", "start_fraction"},
    "rpud_msgs/msg/Waveform": {"header.stamp", "sample_period", "sequence"},
}
_MAX_DURATION = 7e9  # s; with any stamp the times are 64-bit nanoseconds


def holds_rows(type_name: str, columns: tuple[Column, ...]) -> bool:
    """Return whether messages of a type with these columns are blocks of rows."""
    names = {column.name for column in columns}
    simple = all(column.kind not in (Kind.ARRAY, Kind.NESTED) for column in columns)
    return type_name in _TIME_COLUMNS and _TIME_COLUMNS[type_name] <= names and simple


def row_columns(columns: tuple[Column, ...]) -> tuple[Column, ...]:
    """Return the columns of the table of rows: ``TIME``, and numbers in place of sequences."""
    return (
        TIME,
        *(
            dataclasses.replace(column, kind=Kind.NUMBER)
            if column.kind is Kind.SEQUENCE
            else column
            for column in columns
        ),
    )


def to_rows(
    columns: tuple[Column, ...], blocks: Mapping[str, np.ndarray | Sequences]
) -> dict[str, np.ndarray]:
    """Return the values of ``row_columns``, one for each row, from those of each block.

    Each row has the values that its block has once. ``sequence`` is the number of the row.
    """
    sequences = {name: each for name, each in blocks.items() if isinstance(each, Sequences)}
    single = {name: each for name, each in blocks.items() if not isinstance(each, Sequences)}
    first = next(iter(sequences))
    counts = sequences[first].counts
    for name, each in sequences.items():
        for row in np.flatnonzero(counts != each.counts):
            raise BagFormatError(f"{name} has {each.counts[row]} values, and {first} {counts[row]}")
    rows = {
        column.name: sequences[column.name].values
        if column.name in sequences
        else np.repeat(single[column.name], counts)
        for column in columns
    }
    numbers = np.arange(len(rows["sequence"])) - np.repeat(np.cumsum(counts) - counts, counts)
    if "sample_period" in rows:
        time = _sample_times(single, counts)
    else:
        time = rows["origin"] + _starts(rows["start_seconds"], rows["start_fraction"])
    rows["sequence"] = rows["sequence"] + numbers.astype(np.uint64)
    return {TIME.name: time, **rows}


def _starts(seconds: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Return the starts of segments since simulation time zero [ns]."""
    fits = (seconds >= 0) & (seconds < _MAX_DURATION) & (fractions >= 0.0) & (fractions <= 1.0)
    for row in np.flatnonzero(~fits):
        raise BagFormatError(f"a segment starts at {seconds[row]} s + {fractions[row]:g} s")
    return seconds * SECOND + np.rint(fractions * SECOND).astype(np.int64)


def _sample_times(blocks: Mapping[str, np.ndarray], counts: np.ndarray) -> np.ndarray:
    stamps, periods, firsts = blocks["header.stamp"], blocks["sample_period"], blocks["sequence"]
    offsets: list[np.ndarray] = [np.empty(0, np.int64)]
    # Blocks of one rate together: the offsets of one block take as long as those of a hundred.
    edges = np.flatnonzero(np.diff(periods, prepend=np.nan, append=np.nan))
    for start, end in pairwise(edges.tolist()):
        offsets.append(_offsets(float(periods[start]), firsts[start:end], counts[start:end]))
    return np.repeat(stamps, counts) + np.concatenate(offsets)


def _offsets(period: float, firsts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the times of samples after the first of their block [ns].

    At a whole rate each time is rounded as that of the first one. Otherwise the times of samples
    would depend on how they are divided into blocks. ``period`` is in s.
    """
    most = int(counts.max())
    if not (math.isfinite(period) and period > 0.0 and period * most < _MAX_DURATION):
        count = int(counts[0])
        raise BagFormatError(f"sample_period = {period:g} s is no time between {count} samples")
    numbers = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rate = round(1.0 / period) if period > 1.0 / SECOND else 0
    if rate and abs(rate * period - 1.0) < 1e-12:
        starts = np.repeat((firsts % np.uint64(rate)).astype(np.int64), counts)
        return (starts + numbers) * SECOND // rate - starts * SECOND // rate
    return np.rint(numbers * (period * SECOND)).astype(np.int64)
