"""Fields of a record as plain numbers, read from its bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

# NumPy builds an object for the record and one for each field, which takes many times as long.
_CODES = {"f8": "d", "i8": "q"}


def reader_of(dtype: np.dtype, *names: str) -> Callable[[np.ndarray], tuple[Any, ...]]:
    """Return a function that reads fields of the first record of an array.

    Args:
        names: of fields of 64 bits, in the order in which the dtype has them.
    """
    layout, end = "=", 0
    fields: Mapping[str, Any] = dtype.fields or {}
    for name in names:
        kind, offset = fields[name][:2]
        layout += f"{offset - end}x{_CODES[kind.str[1:]]}"
        end = offset + kind.itemsize
    read: Any = struct.Struct(layout).unpack_from  # takes arrays as buffers
    return read
