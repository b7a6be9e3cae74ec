"""Result of a campaign: counts by the way that inputs took, harms, and their table."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterable


@dataclasses.dataclass
class Tally:
    """Counts and extremes of the inputs of one way."""

    inputs: int = 0
    refused: int = 0
    slowest: float = 0.0  # [s]
    largest: int = 0  # memory of a process of its own [byte]

    def add(self, refused: bool, seconds: float, memory: int = 0) -> None:
        """Count one input."""
        self.inputs += 1
        self.refused += refused
        self.slowest = max(self.slowest, seconds)
        self.largest = max(self.largest, memory)


class Outcome:
    """Result of a campaign."""

    def __init__(self, ways: Iterable[str]) -> None:
        self.tallies = {way: Tally() for way in ways}
        self.harms: list[str] = []

    def show(self) -> None:
        """Print the counts, and the first harms."""
        row = "{:28} {:>8} {:>8} {:>14} {:>12}".format
        print(row("way", "inputs", "refused", "slowest [ms]", "most [MB]"))
        for way, each in self.tallies.items():
            slowest, largest = f"{1e3 * each.slowest:.1f}", f"{each.largest / 1e6:.0f}"
            print(row(way, each.inputs, each.refused, slowest, largest))
        print(f"harms: {len(self.harms)}")
        for harm in self.harms[:20]:
            print(f"harmed: {harm}", file=sys.stderr)
