"""NumPy files: one folder for each table, with one growing file for each column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.format import dtype_to_descr, write_array_header_1_0

from rpud_sim.bag.columns import Column, Kind
from rpud_sim.foundation.values import to_json
from rpud_sim.recorded import InspectionError

_MOST_TEXT = 2**31 - 1  # of a batch [bytes], for offsets of 32 bits


def packed(column: Column, values: Any, as_text: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return where each value begins and the last one ends, and all values one after the other.

    Texts are UTF-8 bytes; ``as_text`` writes other values as JSON.
    """
    if not as_text:
        ends = np.cumsum([0, *map(len, values)])
        return ends, np.concatenate([np.empty(0, column.dtype), *values])
    texts = np.empty(len(values), object)
    texts[:] = values if column.kind is Kind.TEXT else [to_json(value) for value in values]
    # Rows of a block have the same text.
    starts = np.flatnonzero(np.append([True], texts[1:] != texts[:-1])[: len(texts)])
    counts = np.diff(starts, append=len(texts))
    parts = [text.encode() for text in texts[starts]]
    sizes = np.array([*map(len, parts)], np.int64)
    if int((sizes * counts).sum()) > _MOST_TEXT:
        raise InspectionError(f"column {column.name:.80}: a batch has more than 2 GiB of text")
    data = b"".join(part * count for part, count in zip(parts, counts.tolist(), strict=True))
    ends = np.cumsum(np.append([0], np.repeat(sizes, counts)))
    return ends, np.frombuffer(data, np.uint8)


class NumpyFolder:
    """Table as a folder of ``.npy`` files, which can be mapped into memory.

    Times and durations are integer nanoseconds. A column without a fixed length takes two files:
    row n lies in ``name.npy`` from ``name.offsets.npy`` [n] to [n + 1]. Texts are their UTF-8
    bytes; sequences of other things than numbers are JSON text. ``metadata`` is not written, since
    the files have no place for it.
    """

    def __init__(self, path: Path, columns: Sequence[Column], metadata: Mapping[str, Any]) -> None:
        path.mkdir()
        self._columns = columns
        self._files: dict[str, _GrowingFile] = {}
        for column in columns:
            text = column.kind in (Kind.TEXT, Kind.NESTED)
            dtype = np.dtype(np.uint8) if text else column.dtype
            shape = (column.length,) if column.kind is Kind.ARRAY else ()
            self._add(path, column.name, dtype, shape)
            if text or column.kind is Kind.SEQUENCE:
                offsets = self._add(path, f"{column.name}.offsets", np.dtype(np.int64))
                offsets.write(np.zeros(1, np.int64))
        self.paths = [file.path for file in self._files.values()]

    def _add(
        self, path: Path, name: str, dtype: np.dtype, shape: tuple[int, ...] = ()
    ) -> _GrowingFile:
        file = self._files[name] = _GrowingFile(path / f"{name}.npy", dtype, shape)
        return file

    def write(self, values: Mapping[str, np.ndarray]) -> None:
        for column in self._columns:
            file, found = self._files[column.name], values[column.name]
            if (offsets := self._files.get(f"{column.name}.offsets")) is not None:
                ends, found = packed(column, found, column.kind is not Kind.SEQUENCE)
                offsets.write(file.length + ends[1:])
            file.write(found)

    def close(self) -> None:
        for file in self._files.values():
            file.close()


class _GrowingFile:
    """Growing ``.npy`` file whose length is written at the end.

    It is not kept open: a bag may have more columns than a process may have open files.
    """

    def __init__(self, path: Path, dtype: np.dtype, shape: tuple[int, ...]) -> None:
        self.path = path  # of the file
        self.length = 0  # rows so far
        self._dtype, self._shape = dtype, shape
        with path.open("xb") as stream:
            self._write_header(stream)
            self._begin = stream.tell()

    def write(self, values: np.ndarray) -> None:
        with self.path.open("ab") as stream:
            stream.write(np.ascontiguousarray(values, self._dtype).data)
        self.length += len(values)

    def close(self) -> None:
        with self.path.open("r+b") as stream:
            self._write_header(stream)
            # Or rows would be overwritten; NumPy pads the header for the greatest length.
            assert stream.tell() == self._begin

    def _write_header(self, stream: Any) -> None:
        shape = (self.length, *self._shape)
        descr = dtype_to_descr(self._dtype)
        write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
