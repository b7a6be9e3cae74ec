"""Frames: what the browser shows next, as a header in JSON and arrays in binary.

A frame is ``uint32 n`` (little-endian), n bytes of the header, zeros up to a multiple of 8, and the
arrays, each filled up to a multiple of 8. In the header an array is ``{"$": [offset, length,
type]}``: the offset counts from the first array [bytes], the type is ``f4`` or ``f8``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.foundation.terminal import printable

_ALIGNED = 8  # bytes


def encode(frame: Mapping[str, Any]) -> bytes:
    """Return the bytes of a frame.

    Its values are plain ones, mappings, sequences and one-dimensional arrays. Times need double
    precision, and have it; other arrays become single. Equal arrays are sent once. A scalar that is
    not finite becomes null.
    """
    arrays: dict[bytes, list[Any]] = {}
    size = 0

    def plain(value: Any) -> Any:
        nonlocal size
        if isinstance(value, np.ndarray):
            kind = "f8" if value.dtype == np.float64 else "f4"
            data = np.ascontiguousarray(value, f"<{kind}").tobytes()
            data += bytes(-len(data) % _ALIGNED)
            if (reference := arrays.get(data)) is None:
                reference = arrays[data] = [size, len(value), kind]
                size += len(data)
            return {"$": [reference[0], len(value), kind]}
        if isinstance(value, Mapping):
            return {printable(str(key)): plain(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [plain(each) for each in value]
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return printable(value) if isinstance(value, str) else value

    header = json.dumps(plain(frame), separators=(",", ":"), allow_nan=False).encode()
    head = len(header).to_bytes(4, "little") + header
    return b"".join([head, bytes(-len(head) % _ALIGNED), *arrays])
