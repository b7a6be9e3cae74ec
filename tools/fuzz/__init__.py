"""Hostile inputs to every way into the drill, and hostile bags to every reader."""

from __future__ import annotations

import dataclasses
import sys


@dataclasses.dataclass
class Way:
    """Counts of the inputs that took one way."""

    inputs: int = 0
    refused: int = 0
    slowest: float = 0.0  # [s]
    largest: float = 0.0  # memory of a process of its own [MB]


class Outcome:
    """Counts by way, and harms, each with the number and the seed that draw its input again."""

    def __init__(self) -> None:
        self.ways: dict[str, Way] = {}
        self.harms: list[str] = []

    def add(self, way: str, refused: bool, seconds: float, memory: float = 0.0) -> None:
        """Count one input."""
        each = self.ways.setdefault(way, Way())
        each.inputs, each.refused = each.inputs + 1, each.refused + refused
        each.slowest, each.largest = max(each.slowest, seconds), max(each.largest, memory)

    def show(self) -> None:
        """Print the counts, and the first harms."""
        print(f"{'way':28} {'inputs':>8} {'refused':>8} {'slowest [ms]':>14} {'most [MB]':>12}")
        for way, each in sorted(self.ways.items()):
            numbers = f"{each.inputs:8} {each.refused:8} {1e3 * each.slowest:14.1f}"
            print(f"{way:28} {numbers} {each.largest:12.0f}")
        print(f"harms: {len(self.harms)}")
        print(*(f"harmed: {harm}" for harm in self.harms[:20]), sep="\n", file=sys.stderr)
