"""Values of messages as JSON has them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np

_PIECE = 65_536  # elements


def name_of(number: float) -> str:
    """Return the name of a number that JSON lacks: ``NaN``, ``Infinity`` or ``-Infinity``."""
    return "NaN" if math.isnan(number) else "Infinity" if number > 0 else "-Infinity"


def finite_values(value: Any, instead: Callable[[float], object] = lambda number: None) -> Any:
    """Return plain values with null, or what is ``instead``, for NaN and infinity."""
    if isinstance(value, dict):
        return {name: finite_values(each, instead) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite_values(each, instead) for each in value]
    return instead(value) if isinstance(value, float) and not math.isfinite(value) else value


def to_json(value: Any) -> str:
    """Return a value as one line of JSON; NaN and infinity, which JSON lacks, are texts."""
    if isinstance(value, np.ndarray) and value.size > _PIECE:
        # One list of everything would take many times the memory of the array.
        pieces = (to_json(value[at : at + _PIECE])[1:-1] for at in range(0, len(value), _PIECE))
        return f"[{', '.join(pieces)}]"
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    try:
        return json.dumps(plain, ensure_ascii=False, allow_nan=False)
    except ValueError:
        return json.dumps(finite_values(plain, name_of), ensure_ascii=False)
