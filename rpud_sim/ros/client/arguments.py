"""Arguments of commands, converted to fields of messages; the drill itself checks their ranges."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Duration, Time

from rpud_sim.foundation.quantities import ParameterError, Quantity, shown
from rpud_sim.foundation.time import SECOND, split_seconds

SECONDS = Quantity("s", "a duration", 0.0, 2.0**31, below=True)
SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)
FAULT_NUMBER = Quantity("", "the number of a fault", 1, 2**32 - 1, whole=True)


def to_number(name: str, value: Any) -> float:
    """Return a number as a float, which a message needs."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{name} = {shown(value)} is not a number") from None


def to_text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ParameterError(f"{name} = {shown(value)} is not a text")
    return value


def to_duration(name: str, seconds: Any) -> Duration:
    """Return seconds as a message."""
    whole, rest = _split(name, seconds)
    return Duration(sec=whole, nanosec=rest)


def to_time(name: str, seconds: Any) -> Time:
    """Return a stamp [s] as a message."""
    whole, rest = _split(name, seconds)
    return Time(sec=whole, nanosec=rest)


def _split(name: str, seconds: Any) -> tuple[int, int]:
    return split_seconds(min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1))
