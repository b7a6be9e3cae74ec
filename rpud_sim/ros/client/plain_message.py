"""Messages of any type as plain values, and paths to their fields."""

from __future__ import annotations

import math
import re
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.ros.graph import message_class

CUT = 128  # elements of an array, or characters of a text, that are shown unless all are wanted

_PART = re.compile(r"([A-Za-z]\w*)((?:\[\d+\])*)")
_ELEMENT = re.compile(r"sequence<(.+?)(?:, *\d+)?>|(.+)\[\d+\]")
_MESSAGE = re.compile(r"(\w+)/(\w+)")


def to_plain(value: Any, cut: int | None = None) -> Any:
    """Convert a message or a field to plain values; arrays and texts end at ``cut`` in ``...``."""
    if hasattr(value, "get_fields_and_field_types"):
        return {
            name: to_plain(getattr(value, name), cut) for name in value.get_fields_and_field_types()
        }
    if isinstance(value, str):
        return value if cut is None or len(value) <= cut else value[:cut] + "..."
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if isinstance(value, (bool, int, float)):
        return value
    if not hasattr(value, "__len__"):  # NumPy's numbers
        return value.item()
    kept = value if cut is None else value[:cut]
    plain = kept.tolist() if hasattr(kept, "tolist") else [to_plain(each, cut) for each in kept]
    return plain if len(kept) == len(value) else [*plain, "..."]


def to_json_value(value: Any) -> Any:
    """Return plain values with null in place of numbers that JSON has not: NaN and infinity."""
    if isinstance(value, dict):
        return {name: to_json_value(each) for name, each in value.items()}
    if isinstance(value, list):
        return [to_json_value(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class FieldPath:
    """Path to a field of a message, such as ``header.stamp.sec`` or ``faults[0].kind``."""

    def __init__(self, text: str, kind: Any) -> None:
        self._steps: list[str | int] = []
        described = ""
        for part in text.split("."):
            match = _PART.fullmatch(part)
            if match is None:
                raise ParameterError(
                    f"field {shown(text)} is not a path such as header.stamp or faults[0].kind"
                )
            name, indices = match.groups()
            fields = {} if kind is None else kind.get_fields_and_field_types()
            if name not in fields:
                hint = did_you_mean(name, fields) if fields else f"{described} has no fields"
                raise ParameterError(f"field {shown(text)}: there is no {shown(name)}; {hint}")
            self._steps.append(name)
            described = fields[name]
            for index in re.findall(r"\d+", indices):
                element = _ELEMENT.fullmatch(described)
                if element is None:
                    raise ParameterError(f"field {shown(text)}: {described} is not an array")
                described = element[1] or element[2]
                self._steps.append(int(index))
            message = _MESSAGE.fullmatch(described)
            kind = message_class(f"{message[1]}/msg/{message[2]}") if message else None

    def value(self, message: Any) -> Any:
        """Return the field of a message; None if an array is too short."""
        value = message
        for step in self._steps:
            if isinstance(step, str):
                value = getattr(value, step)
            elif step < len(value):
                value = value[step]
            else:
                return None
        return value
