"""Arguments of a client's methods as fields of messages; the drill itself checks their ranges."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rclpy.parameter import Parameter

from rpud_sim.foundation.quantities import ParameterError, Quantity, as_number, short_repr
from rpud_sim.foundation.time import SECOND, split_seconds

SECONDS = Quantity("s", "a duration", 0.0, 2.0**31, below=True)


def to_time(kind: Any, name: str, seconds: Any) -> Any:
    """Return seconds as a ``Time`` or ``Duration``; others than those are a ParameterError."""
    total = min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1)
    sec, nanosec = split_seconds(total)
    return kind(sec=sec, nanosec=nanosec)


def to_parameter(name: str, value: Any) -> Parameter:
    try:
        return Parameter(name, value=value.item() if isinstance(value, np.generic) else value)
    except TypeError:
        raise ParameterError(f"{name} = {short_repr(value)} is of no type of ROS") from None


def to_number(name: str, value: Any) -> float:
    number = as_number(value)
    if math.isnan(number) and not isinstance(value, float):
        raise ParameterError(f"{name} = {short_repr(value)} is not a number")
    return number
