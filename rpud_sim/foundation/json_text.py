"""Text in JSON, which has no number for NaN and infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

from rpud_sim.foundation.quantities import ExpectedError


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


def check_finite(value: Any) -> None:
    """Raise ``ExpectedError`` if there is NaN or infinity in plain values."""
    for name, number in _not_finite(value, ""):
        raise ExpectedError(f"{name or 'the result'} = {number} is not a finite number")


def json_text(value: Any, **layout: Any) -> str:
    """Return plain values as JSON; ``layout`` goes to ``json.dumps``.

    NaN or infinity raises ``ExpectedError``. Where null is documented for them, call
    ``finite_values`` before.
    """
    try:
        return json.dumps(value, allow_nan=False, **layout)
    except ValueError:
        check_finite(value)
        raise


def _not_finite(value: Any, place: str) -> Iterator[tuple[str, float]]:
    """Yield each number that is not finite, with its place such as ``standard_error.depth``."""
    if isinstance(value, dict):
        for name, each in value.items():
            yield from _not_finite(each, f"{place}.{name}" if place else str(name))
    elif isinstance(value, list | tuple):
        for number, each in enumerate(value):
            yield from _not_finite(each, f"{place}[{number}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield place, value
