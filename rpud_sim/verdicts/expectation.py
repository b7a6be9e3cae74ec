"""Expectation: a named formula, and the topics that it needs."""

from __future__ import annotations

import dataclasses

from rpud_sim.verdicts.names import check_formula
from rpud_sim.verdicts.vocabulary import (
    Active,
    Cleared,
    Compare,
    Formula,
    Message,
    Onset,
    Quantile,
    Says,
)

# Topics that each expectation needs: they show where runs begin, and how far they go.
ALWAYS_NEEDED = ("journal", "status")


@dataclasses.dataclass(frozen=True)
class Expectation:
    """Named formula that must hold from the beginning of a run."""

    name: str  # for people
    formula: Formula  # to hold
    requirement: str = ""  # its identifier; empty for none

    def __post_init__(self) -> None:
        check_formula(self.formula)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics that a record needs, in the order of their names."""
        return tuple(sorted({*ALWAYS_NEEDED, *self.used_topics}))

    @property
    def used_topics(self) -> tuple[str, ...]:
        """Topics that the formula names, in the order of their names."""
        found = set()
        for part in self.formula.walk():
            if isinstance(part, (Compare, Says, Quantile)):
                found.add(part.signal.topic)
            elif isinstance(part, Message):
                found.add(part.topic)
            elif isinstance(part, (Active, Onset, Cleared)):
                found.add("faults")
        return tuple(sorted(found))
