"""NumPy files: one folder for each table, with one growing file for each column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.format import dtype_to_descr, write_array_header_1_0

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.foundation.json_values import to_json

_VARYING = (Kind.SEQUENCE, Kind.TEXT, Kind.NESTED)


class NumpyFolder:
    """Table as a folder of ``.npy`` files, which can be mapped into memory.

    Times and durations are integer nanoseconds. A column without a fixed length takes two files:
    row n lies in ``name.npy`` from ``name.offsets.npy`` [n] to [n + 1]. Texts are their UTF-8
    bytes; sequences of other things than numbers are JSON text. ``metadata`` is not written, since
    the files have no place for it.
    """

    def __init__(self, path: Path, columns: Sequence[Column], metadata: Mapping[str, Any]) -> None:
        self._columns = columns
        path.mkdir()
        self._files: dict[str, _GrowingFile] = {}
        for column in columns:
            name = column.name
            if column.kind in _VARYING:
                dtype = column.dtype if column.kind is Kind.SEQUENCE else np.dtype(np.uint8)
                self._files[name] = _GrowingFile(path / f"{name}.npy", dtype)
                offsets = _GrowingFile(path / f"{name}.offsets.npy", np.dtype(np.int64))
                offsets.write(np.zeros(1, np.int64))
                self._files[f"{name}.offsets"] = offsets
            else:
                shape = (column.length,) if column.kind is Kind.ARRAY else ()
                self._files[name] = _GrowingFile(path / f"{name}.npy", column.dtype, shape)
        self.paths = [file.path for file in self._files.values()]

    def write(self, values: Mapping[str, np.ndarray]) -> None:
        for column in self._columns:
            file = self._files[column.name]
            found = values[column.name]
            if column.kind in _VARYING:
                lengths, found = _concatenate(column, found)
                ends = file.length + np.cumsum(lengths, dtype=np.int64)
                self._files[f"{column.name}.offsets"].write(ends)
            file.write(found)

    def close(self) -> None:
        for file in self._files.values():
            file.close()


def _concatenate(column: Column, values: np.ndarray) -> tuple[list[int], np.ndarray]:
    if column.kind is Kind.SEQUENCE:
        return [*map(len, values)], np.concatenate([np.empty(0, column.dtype), *values])
    texts = values if column.kind is Kind.TEXT else map(to_json, values)
    encoded = [text.encode() for text in texts]
    return [*map(len, encoded)], np.frombuffer(b"".join(encoded), np.uint8)


class _GrowingFile:
    """Growing ``.npy`` file whose length is written at the end.

    It is not kept open: a bag may have more columns than a process may have open files.
    """

    def __init__(self, path: Path, dtype: np.dtype, shape: tuple[int, ...] = ()) -> None:
        self.path = path  # of the file
        self.dtype = dtype  # of its numbers
        self.length = 0  # rows so far
        self._shape = shape
        with path.open("xb") as stream:
            self._write_header(stream)
            self._begin = stream.tell()

    def write(self, values: np.ndarray) -> None:
        with self.path.open("ab") as stream:
            stream.write(np.ascontiguousarray(values, self.dtype).data)
        self.length += len(values)

    def close(self) -> None:
        with self.path.open("r+b") as stream:
            self._write_header(stream)
            # Or rows would be overwritten; NumPy pads the header for the greatest length.
            assert stream.tell() == self._begin

    def _write_header(self, stream: Any) -> None:
        shape = (self.length, *self._shape)
        descr = dtype_to_descr(self.dtype)
        write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
