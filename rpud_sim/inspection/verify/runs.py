"""Which run of a journal a recorded message belongs to, by the order in which both were sent."""

from __future__ import annotations

import dataclasses
from bisect import bisect_left, bisect_right
from collections.abc import Iterable
from itertools import pairwise

from rpud_sim.bag import Message
from rpud_sim.simulation.journal import JournalEntry

BEGINNINGS = ("begin", "origin")
"""Kinds of entries after which stamps may repeat: each begins a stretch, counted from 0."""


Position = tuple[int, int]
"""How far the drill has come: number of the stretch, and its stamp there [ns]."""


@dataclasses.dataclass(frozen=True)
class Span:
    """What a bag covers, as all of its topics together show.

    Args:
        begun: from here on a topic that is heard at all should be in the bag.
        reached: up to here it should be.
    """

    begun: Position
    reached: Position


class Stretches:
    """Stretches of a journal, each of one simulation and one origin of time.

    Stamps of different stretches may be equal, so they do not tell a message's stretch. The time
    at which it was published does: the drill publishes entries and messages in one order. Entries
    may come shortly after the first messages of their stretch, but never before the entry ahead.

    Args:
        journal: its entries in order, with the messages that they came in.
    """

    def __init__(self, journal: Iterable[tuple[Message, JournalEntry]]) -> None:
        self._earliest: list[int] = []  # a message of each stretch may be published [ns]
        self._begins: list[int] = []  # at which the entry was published [ns]
        self._runs = 0
        self._ended = False
        before, beginning = 0, False
        for message, entry in journal:
            if entry.kind in BEGINNINGS:
                # Entries that begin together are published together.
                self._earliest.append(self._earliest[-1] if beginning else before)
                self._begins.append(message.publish_time)
                self._runs += not beginning
            beginning = entry.kind in BEGINNINGS
            self._ended = entry.kind == "end"
            before = message.publish_time
        # The clock was set back meanwhile, or another program wrote these times.
        self._ordered = all(
            first <= second
            for times in (self._earliest, self._begins)
            for first, second in pairwise(times)
        )

    @property
    def runs(self) -> int:
        """Number of stretches that messages can belong to."""
        return self._runs

    @property
    def ended(self) -> bool:
        """Whether the last entry says that the drill ended."""
        return self._ended

    def of(self, message: Message) -> tuple[int, int]:
        """Return the first and the last stretch that a message may belong to."""
        final = max(0, len(self._begins) - 1)
        if not self._ordered:
            return 0, final
        first = bisect_left(self._begins, message.publish_time) - 1
        last = bisect_right(self._earliest, message.publish_time) - 1
        return max(0, first), min(max(0, first, last), final)
