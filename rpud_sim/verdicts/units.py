"""Numbers with units, also as windows of time, and their conversion to the unit of a field."""

from __future__ import annotations

import dataclasses
import math
import re
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, short_repr
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.units import PREFIXED, UNITS, Unit

LONGEST = 1e9  # greatest duration in an expectation [s]

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*")


def parse_quantity(text: str) -> tuple[float, str]:
    """Return number and unit of a text such as ``45 N``."""
    match = _QUANTITY.fullmatch(text)
    number = float(match[1]) if match else math.nan
    if match is None or not math.isfinite(number):
        raise ParameterError(f"{short_repr(text)} is not a number with a unit, such as 45 N")
    find_unit(match[2])
    return number, match[2]


def find_unit(name: str) -> Unit:
    if name not in UNITS:
        # One letter resembles no other, and all names would be a long line.
        alike = [each for each in UNITS if each and each.lower() == name.lower()]
        hint = f"; did you mean {alike[0]}?" if alike else did_you_mean(name, PREFIXED)
        raise ParameterError(f"unit {short_repr(name)} is unknown{hint}")
    return UNITS[name]


def to_si(value: float, unit: str, wanted: str, name: str) -> float:
    """Return a value in the SI unit of a field.

    ``unit`` may only be empty for zero or for a field without a unit. ``wanted``, the field's unit,
    is empty for a pure number.
    """
    found = find_unit(unit)
    if found.si != wanted and not (value == 0.0 and unit == ""):
        given = f"{value:g} {unit}".rstrip()
        needs = f"is in {wanted}" if wanted else "is a number without a unit"
        raise ParameterError(f"{name} {needs}, given {given}")
    return found.to_si(value)


def parse_duration(value: str | float, name: str) -> int:
    """Return a duration [ns] from a text such as ``500 ms`` or from seconds, in [0, 1e9] s."""
    if isinstance(value, str):
        seconds = to_si(*parse_quantity(value), "s", name)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        seconds = float(value) if abs(value) <= LONGEST else math.inf
    else:
        raise ParameterError(f"{name} = {short_repr(value)} is not a duration, such as 0.5 s")
    if not 0.0 <= seconds <= LONGEST:
        raise ParameterError(f"{name} = {seconds:g} s is outside its range [0, {LONGEST:g}] s")
    return round(seconds * SECOND)


def duration_text(nanoseconds: int) -> str:
    """Return a duration as text that ``parse_duration`` reads back exactly."""
    text = f"{nanoseconds / SECOND:.9g}"
    if round(float(text) * SECOND) != nanoseconds:
        text = f"{nanoseconds // SECOND}.{nanoseconds % SECOND:09d}"
    return f"{text} s"


@dataclasses.dataclass(frozen=True)
class Number:
    """Number with a unit as it was written."""

    value: float
    unit: str = ""

    def __str__(self) -> str:
        text = f"{self.value:g}"
        return f"{text if float(text) == self.value else repr(self.value)} {self.unit}".rstrip()


ZERO = Number(0.0)


def to_number(value: str | float) -> Number:
    """Return a number from a text such as ``45 N``, or from a number without a unit."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise ParameterError(f"{short_repr(value)} is not a number with a unit, such as 45 N")
    return Number(*parse_quantity(value if isinstance(value, str) else repr(float(value))))


@dataclasses.dataclass(frozen=True)
class Window:
    """Closed interval of time after an instant."""

    start: int = 0  # first nanosecond after the instant
    end: int | None = None  # last nanosecond after it; None for the end of the recording

    def __post_init__(self) -> None:
        if self.end is not None and self.end < self.start:
            raise ParameterError(
                f"between {self.start / 1e9:g} s and {self.end / 1e9:g} s ends before it begins"
            )

    def last(self, time: int, end: int) -> int:
        """Return the last instant of the window after a time, in a recording up to ``end`` [ns]."""
        return end if self.end is None else min(time + self.end, end)


WHOLE = Window()  # the rest of the recording


def window(within: Any = None, between: Any = None) -> Window:
    """Return a window from its end, or from start and end; of neither, the rest of the recording.

    Both are as ``0.5 s``; an end of None is the recording's end.
    """
    if within is not None and between is not None:
        raise ParameterError("within and between exclude each other")
    if between is None:
        return WHOLE if within is None else Window(0, parse_duration(within, "within"))
    if not isinstance(between, (list, tuple)) or len(between) != 2:
        raise ParameterError(f"between = {short_repr(between)} is not [start, end], as [1 s, 2 s]")
    first, last = between
    end = None if last is None else parse_duration(last, "between")
    return Window(parse_duration(first, "between"), end)
