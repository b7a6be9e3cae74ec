"""Tables of messages that hold many samples or segments, with one row for each of these."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.foundation.time import SECOND

TIME = Column("time", Kind.TIME, np.dtype(np.int64), description="of the sample or segment")
"""Column with the exact time of each row."""

# Columns from which the time of a row is calculated, by type.
_TIME_COLUMNS = {
    "rpud_msgs/msg/Trajectory": {"origin", "sequence", "start_seconds", "start_fraction"},
    "rpud_msgs/msg/Waveform": {"header.stamp", "sample_period", "sequence"},
}
_MAX_DURATION = 9e9  # s; times are 64-bit nanoseconds


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


def to_rows(columns: tuple[Column, ...], blocks: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the values of ``row_columns``, one for each row.

    Each row has the values that its block has once. ``sequence`` is the number of the row.

    Args:
        columns: of the blocks.
        blocks: values of these columns, one for each block.

    Raises:
        BagFormatError: if the sequences of a block differ in length, or its times are impossible.
    """
    sequences = [column.name for column in columns if column.kind is Kind.SEQUENCE]
    lengths = np.array([[len(values) for values in blocks[name]] for name in sequences], np.int64)
    counts = lengths[0]
    for name, others in zip(sequences, lengths, strict=True):
        for count, other in zip(counts[counts != others], others[counts != others], strict=True):
            raise BagFormatError(f"{name} has {other} values, and {sequences[0]} {count}")
    rows = {
        column.name: np.concatenate([np.empty(0, column.dtype), *blocks[column.name]])
        if column.kind is Kind.SEQUENCE
        else np.repeat(blocks[column.name], counts)
        for column in columns
    }
    numbers = np.arange(len(rows["sequence"])) - np.repeat(np.cumsum(counts) - counts, counts)
    if "sample_period" in rows:
        time = _sample_times(blocks, counts)
    else:
        time = rows["origin"] + rows["start_seconds"] * SECOND
        time += np.rint(rows["start_fraction"] * SECOND).astype(np.int64)
    rows["sequence"] = rows["sequence"] + numbers.astype(np.uint64)
    return {TIME.name: time, **rows}


def _sample_times(blocks: Mapping[str, np.ndarray], counts: np.ndarray) -> np.ndarray:
    pieces = [
        stamp + _offsets(float(period), int(first), int(count))
        for stamp, period, first, count in zip(
            blocks["header.stamp"],
            blocks["sample_period"],
            blocks["sequence"],
            counts,
            strict=True,
        )
    ]
    return np.concatenate([np.empty(0, np.int64), *pieces])


def _offsets(period: float, first: int, count: int) -> np.ndarray:
    """Return the times of samples after the first of them [ns], whose number is ``first``.

    At a whole rate each time is rounded as that of the first one. Otherwise the times of samples
    would depend on how they are divided into blocks.
    """
    if not (math.isfinite(period) and period > 0.0 and period * count < _MAX_DURATION):
        raise BagFormatError(f"sample_period = {period:g} s is no time between {count} samples")
    numbers = np.arange(count)
    rate = round(1.0 / period) if period > 1.0 / SECOND else 0
    if rate and abs(rate * period - 1.0) < 1e-12:
        first %= rate
        return (first + numbers) * SECOND // rate - first * SECOND // rate
    return np.rint(numbers * (period * SECOND)).astype(np.int64)
