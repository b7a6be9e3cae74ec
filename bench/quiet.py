"""Turns in which other virtual machines took much of the processors are measured again."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TypeVar

from bench.machine import processor_time

Result = TypeVar("Result")

MOST_STOLEN = 0.03
"""Share of the processor time up to which a turn counts as undisturbed."""
ATTEMPTS = 2


def undisturbed(measure: Callable[[], Result]) -> Result:
    """Measure until others took at most 3 % meanwhile, twice at most; return the best turn.

    The best turn is that in which others took least, whatever it measured.
    """
    turns: list[tuple[float, Result]] = []
    while len(turns) < ATTEMPTS and not (turns and turns[-1][0] <= MOST_STOLEN):
        whole, stolen = processor_time()
        found = measure()
        whole_after, stolen_after = processor_time()
        turns.append(((stolen_after - stolen) / max(whole_after - whole, 1e-9), found))
    share, found = min(turns, key=lambda turn: turn[0])
    if share > MOST_STOLEN:
        print(f"  others took {100.0 * share:.0f} % in each attempt", file=sys.stderr, flush=True)
    return found
