"""Values that are no single number as JSON text."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

_PIECE = 65_536


def to_text(value: Any) -> str:
    """Give a value as one line of JSON, which has no numbers for NaN and infinity: they are texts.

    Args:
        value: an array, or lists and dictionaries of numbers and texts.
    """
    if isinstance(value, np.ndarray) and value.size > _PIECE:
        # A list of all would take many times the memory of the array.
        pieces = (to_text(value[at : at + _PIECE])[1:-1] for at in range(0, len(value), _PIECE))
        return f"[{', '.join(pieces)}]"
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    try:
        return json.dumps(plain, ensure_ascii=False, allow_nan=False)
    except ValueError:
        return json.dumps(_named(plain), ensure_ascii=False)


def _named(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _named(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_named(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    return value
