"""What the engine computes for an event: calls of each function and of nothing else.

`NUMBA_DISABLE_JIT=1 python -m bench.engine_calls` runs the model as plain Python and counts. The
bits of the results depend on each of these calls: sine and cosine of one angle are one call.
"""

from __future__ import annotations

import math
import os
import sys
from collections import Counter
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from rpud_sim.model import engine
from rpud_sim.model.engine import Engine
from rpud_sim.simulation import preset

FUNCTIONS = ("sin", "exp", "atan2", "acos", "hypot", "sqrt")
NAMES = {"sin": "sine and cosine"}
SETTLED = 0.3  # [s]
DURATION = 1.0  # [s]


def main() -> None:
    """Print the calls of each function for an event, in both regimes."""
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        sys.exit("bench.engine_calls: set NUMBA_DISABLE_JIT=1")
    calls: Counter[str] = Counter()
    _count(calls)
    for regime in ("drilling", "free"):
        drill = Engine(preset(regime))
        drill.advance(0, SETTLED)
        drill.drain()
        calls.clear()
        drill.advance(0, SETTLED + DURATION / 2)
        segments, _ = drill.drain()
        each = (f"{calls[name] / len(segments):.2f} {NAMES.get(name, name)}" for name in FUNCTIONS)
        print(f"{regime}, {len(segments)} events: {', '.join(each)} each")


def _count(calls: Counter[str]) -> None:
    """Let every function of the model count its calls, and take records without compilation."""
    counting = ModuleType("math")
    vars(counting).update(vars(math))
    for name in FUNCTIONS:
        setattr(counting, name, _counting(name, calls))
    for name, module in sys.modules.items():
        if name.startswith("rpud_sim.model") and hasattr(module, "math"):
            vars(module)["math"] = counting
    for name in ("start", "advance"):
        setattr(engine, name, _with_records(getattr(engine, name)))


def _counting(name: str, calls: Counter[str]) -> Callable[..., float]:
    function = getattr(math, name)

    def count(*arguments: float) -> float:
        calls[name] += 1
        result: float = function(*arguments)
        return result

    return count


def _with_records(function: Callable[..., Any]) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        return function(
            *(
                each.view(np.recarray) if isinstance(each, np.ndarray) else each
                for each in arguments
            )
        )

    return call


def _records(value: Any) -> Any:
    return value.view(np.recarray) if isinstance(value, np.ndarray) else value


if __name__ == "__main__":
    main()
