"""Parquet and CSV files: one for each table, written batch by batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv, parquet

from rpud_sim.foundation.json_text import finite_values, json_text, name_of
from rpud_sim.foundation.values import to_json
from rpud_sim.messages.columns import Column, Kind
from rpud_sim.recorded import RecordingError

_SINGLE = (Kind.NUMBER, Kind.TIME, Kind.DURATION)

# Arrow types of those columns that CSV can only hold as numbers and texts.
_PARQUET_TYPES = {
    Kind.TIME: lambda column: pa.timestamp("ns"),
    Kind.DURATION: lambda column: pa.duration("ns"),
    Kind.ARRAY: lambda column: pa.list_(pa.from_numpy_dtype(column.dtype), column.length),
    Kind.SEQUENCE: lambda column: pa.list_(pa.from_numpy_dtype(column.dtype)),
}


class _ArrowFile:
    """File of one table."""

    def __init__(self, path: Path, columns: Sequence[Column], schema: pa.Schema) -> None:
        self._columns, self._schema = columns, schema
        self.path = path  # of the file
        self._stream = path.open("xb")
        self._writer: Any = None

    def write(self, values: Mapping[str, Any]) -> None:
        pairs = zip(self._columns, self._schema, strict=True)
        arrays = [_array(column, field.type, values[column.name]) for column, field in pairs]
        self._writer.write_batch(pa.RecordBatch.from_arrays(arrays, schema=self._schema))

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
        texts = [field.name for field in schema if field.type == pa.string()]
        # Times and numbers of samples grow evenly: their differences take no time and no space.
        whole = [c.name for c in columns if c.kind in _SINGLE and c.dtype.kind in "iu"]
        self._writer = parquet.ParquetWriter(
            self._stream,
            schema,
            compression="zstd",
            use_dictionary=texts,
            column_encoding=dict.fromkeys(whole, "DELTA_BINARY_PACKED"),
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

    def write(self, values: Mapping[str, Any]) -> None:
        texts = [column.name for column in self._columns if column.kind is Kind.TEXT]
        super().write({**values, **{name: [*map(_plain, values[name])] for name in texts}})


def _plain(text: str) -> str:
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def _schema(
    columns: Sequence[Column], metadata: Mapping[str, Any], types: Mapping[Kind, Any]
) -> pa.Schema:
    fields = []
    for column in columns:
        if column.kind in types:
            kind = types[column.kind](column)
        else:
            single = column.kind in _SINGLE
            kind = pa.from_numpy_dtype(column.dtype) if single else pa.string()
        about = {"unit": column.unit, "description": column.description}
        fields.append(pa.field(column.name, kind, False, {k: v for k, v in about.items() if v}))
    return pa.schema(
        fields, {key: json_text(finite_values(value, name_of)) for key, value in metadata.items()}
    )


def _array(column: Column, kind: pa.DataType, values: Any) -> pa.Array:
    if kind == pa.string():
        texts = values if column.kind is Kind.TEXT else map(to_json, values)
        found = pa.array([*texts], kind)
        if isinstance(found, pa.ChunkedArray):  # its offsets have 32 bits
            raise RecordingError(f"column {column.name:.80}: a batch has more than 2 GiB of text")
        return found
    if column.kind is Kind.ARRAY:
        numbers = _numbers(values.ravel(), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(numbers, type=kind)
    if column.kind is Kind.SEQUENCE:
        ends = np.cumsum([0, *map(len, values)])
        data = np.concatenate([np.empty(0, column.dtype), *values])
        lists = _numbers(ends.astype(np.int32), pa.int32()), _numbers(data, kind.value_type)
        return pa.ListArray.from_arrays(*lists, type=kind)
    return _numbers(values, kind)


def _numbers(values: np.ndarray, kind: pa.DataType) -> pa.Array:
    """Return numbers as they are: ``pyarrow.array`` would import pandas, which takes 0.5 s."""
    bits = values.dtype == bool
    data = np.packbits(values, bitorder="little") if bits else np.ascontiguousarray(values)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(data)])
