"""Parquet and CSV files: one for each table, written batch by batch."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.foundation.json_values import to_json

_LARGEST_TEXTS = 2**31 - 1  # bytes, for offsets of 32 bits


class _ArrowFile:
    """File of one table."""

    def __init__(self, path: Path, columns: Sequence[Column], schema: pa.Schema) -> None:
        self._columns, self._schema = columns, schema
        self.paths = [path]
        self._stream = path.open("xb")
        self._writer: Any = None

    def close(self) -> None:
        try:
            self._writer.close()
        finally:
            self._stream.close()


class ParquetFile(_ArrowFile):
    """Table as a Parquet file: each batch is a row group.

    Times are timestamps, durations are durations, arrays and sequences of numbers are lists; other
    sequences are JSON text. Units and descriptions are metadata of the columns. ``path`` is without
    its ending.
    """

    def __init__(self, path: Path, columns: Sequence[Column], metadata: Mapping[str, Any]) -> None:
        schema = _schema(columns, metadata, _PARQUET_TYPES)
        super().__init__(path.with_name(f"{path.name}.parquet"), columns, schema)
        # A dictionary of numbers would take three times as long and make the file larger.
        texts = [field.name for field in self._schema if field.type == pa.string()]
        # Times and numbers of samples grow evenly: their differences take no time and no room.
        whole = [column.name for column in columns if _is_whole(column)]
        self._writer = parquet.ParquetWriter(
            self._stream,
            self._schema,
            compression="zstd",
            use_dictionary=texts,
            column_encoding=dict.fromkeys(whole, "DELTA_BINARY_PACKED"),
        )

    def write(self, values: Mapping[str, np.ndarray]) -> None:
        self._writer.write_table(
            pa.Table.from_batches([_batch(self._columns, self._schema, values)])
        )


class CsvFile(_ArrowFile):
    """Table as a CSV file with a line of names.

    Times and durations are integer nanoseconds; arrays and sequences are JSON text. A text that a
    spreadsheet would run as a formula gets a leading apostrophe. ``path`` is without its ending.
    ``metadata`` is not written, since CSV has no place for it.
    """

    def __init__(self, path: Path, columns: Sequence[Column], metadata: Mapping[str, Any]) -> None:
        super().__init__(path.with_name(f"{path.name}.csv"), columns, _schema(columns, {}, {}))
        self._writer = csv.CSVWriter(self._stream, self._schema)

    def write(self, values: Mapping[str, np.ndarray]) -> None:
        plain: dict[str, Any] = {
            column.name: [_escape_formula(text) for text in values[column.name]]
            for column in self._columns
            if column.kind is Kind.TEXT
        }
        self._writer.write_batch(_batch(self._columns, self._schema, {**values, **plain}))


def _escape_formula(text: str) -> str:
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


# Arrow types of those columns that CSV can only hold as numbers and texts.
_PARQUET_TYPES = {
    Kind.TIME: lambda column: pa.timestamp("ns"),
    Kind.DURATION: lambda column: pa.duration("ns"),
    Kind.ARRAY: lambda column: pa.list_(pa.from_numpy_dtype(column.dtype), column.length),
    Kind.SEQUENCE: lambda column: pa.list_(pa.from_numpy_dtype(column.dtype)),
}


def _is_whole(column: Column) -> bool:
    single = column.kind in (Kind.NUMBER, Kind.TIME, Kind.DURATION)
    return single and column.dtype.kind in "iu"


def _schema(
    columns: Sequence[Column], metadata: Mapping[str, Any], types: Mapping[Kind, Any]
) -> pa.Schema:
    fields = []
    for column in columns:
        if column.kind in types:
            kind = types[column.kind](column)
        elif column.kind in (Kind.NUMBER, Kind.TIME, Kind.DURATION):
            kind = pa.from_numpy_dtype(column.dtype)
        else:
            kind = pa.string()
        about = {"unit": column.unit, "description": column.description}
        fields.append(pa.field(column.name, kind, False, {k: v for k, v in about.items() if v}))
    return pa.schema(fields, {key: json.dumps(value) for key, value in metadata.items()})


def _batch(
    columns: Sequence[Column], schema: pa.Schema, values: Mapping[str, np.ndarray]
) -> pa.RecordBatch:
    arrays = [
        _array(column, field.type, values[column.name])
        for column, field in zip(columns, schema, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=schema)


def _array(column: Column, kind: pa.DataType, values: np.ndarray) -> pa.Array:
    if kind == pa.string():
        return _texts(values if column.kind is Kind.TEXT else [to_json(value) for value in values])
    if column.kind is Kind.ARRAY:
        return pa.FixedSizeListArray.from_arrays(
            _numbers(values.ravel(), kind.value_type), type=kind
        )
    if column.kind is Kind.SEQUENCE:
        ends = np.cumsum([0, *map(len, values)])
        numbers = np.concatenate([np.empty(0, column.dtype), *values])
        return pa.ListArray.from_arrays(
            _numbers(ends.astype(np.int32), pa.int32()),
            _numbers(numbers, kind.value_type),
            type=kind,
        )
    return _numbers(values, kind)


# Made of their bytes: pyarrow.array imports pandas, half a second, and looks at each text.


def _numbers(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    if values.dtype == bool:
        data = np.packbits(values, bitorder="little")
    else:
        data = np.ascontiguousarray(values)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(data)])


def _texts(values: Sequence[str] | np.ndarray) -> pa.Array:
    texts = np.empty(len(values), object)
    texts[:] = values
    edges = np.flatnonzero(texts[1:] != texts[:-1]) + 1  # rows of a block have the same text
    starts = np.concatenate([np.zeros(min(1, len(texts)), np.intp), edges])
    counts = np.diff(starts, append=len(texts))
    parts = [text.encode() for text in texts[starts]]
    sizes = np.array([len(part) for part in parts], np.int64)
    if int((sizes * counts).sum()) > _LARGEST_TEXTS:
        return pa.array(texts.tolist(), pa.string())
    ends = np.cumsum(np.repeat(sizes, counts))
    offsets = np.concatenate([np.zeros(1, np.int64), ends]).astype(np.int32)
    data = b"".join([part * count for part, count in zip(parts, counts.tolist(), strict=True)])
    buffers = [None, pa.py_buffer(offsets), pa.py_buffer(data)]
    return pa.Array.from_buffers(pa.string(), len(texts), buffers)
