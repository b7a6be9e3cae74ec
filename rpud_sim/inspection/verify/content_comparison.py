"""Comparison of one topic's recorded messages with all runs together, whatever their times are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rpud_sim.bag import Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.inspection.verify.messages import (
    Key,
    computed_key,
    recorded_key,
    without_padding,
    without_repeats,
)
from rpud_sim.inspection.verify.topic_comparison import Suspect
from rpud_sim.simulation.fields import Fields


class ContentComparison:
    """Second comparison of a topic whose comparison by run has failed.

    ``suspects`` are recorded messages that their run does not give, ``recorded`` are all of the
    topic.
    """

    def __init__(
        self, suspects: Sequence[Suspect], codec: Codec, recorded: Iterator[Message], latched: bool
    ) -> None:
        self.equal = 0  # number of recorded messages that were computed, in the recorded order
        self._codec = codec
        self._recorded = without_repeats(recorded) if latched else recorded
        self._suspects: dict[Key, list[Suspect]] = {}
        for suspect in suspects:
            self._suspects.setdefault(suspect.key, []).append(suspect)
        self._next = self._read_next()

    @property
    def in_order(self) -> bool:
        """Whether every recorded message was computed, in the recorded order."""
        return self._next is None

    @property
    def unmatched(self) -> list[Suspect]:
        """Suspects that no run gives."""
        return [suspect for group in self._suspects.values() for suspect in group]

    def add(self, computed: Fields) -> None:
        """Add the next computed message."""
        key = computed_key(computed)
        awaited = self._next is not None and self._next[0] == key
        if not awaited and key not in self._suspects:
            return
        expected = self._codec.encode(computed)
        if awaited and self._next == (key, expected):
            self.equal += 1
            self._next = self._read_next()
        if key in self._suspects:
            left = [suspect for suspect in self._suspects.pop(key) if suspect.data != expected]
            if left:
                self._suspects[key] = left

    def _read_next(self) -> tuple[Key, bytes] | None:
        message = next(self._recorded, None)
        if message is None:
            return None
        return recorded_key(message, self._codec), without_padding(message, self._codec)
