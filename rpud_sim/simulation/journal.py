"""Journal of a run: every change from outside, from which the run can be repeated.

The content of an entry is one JSON object. Python writes floats with enough digits to read the same
bits back.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any


@dataclasses.dataclass(frozen=True)
class JournalEntry:
    """Entry of a journal: one change from outside."""

    sequence: int  # counts the entries from zero
    time: int  # simulation time of the change [ns]
    kind: str  # one of the KIND constants of ``rpud_msgs/JournalEntry``
    content: Mapping[str, Any]  # details of the kind, by name

    @property
    def text(self) -> str:
        """Time and content as one JSON object."""
        return json.dumps({"time": self.time, **self.content})


class Journal:
    """Journal: a queue of entries, in order."""

    def __init__(self) -> None:
        self._sequence = 0
        self._entries: list[JournalEntry] = []

    def note(self, time: int, kind: str, **content: Any) -> None:
        """Append an entry for a change at a simulation time [ns]."""
        self._entries.append(JournalEntry(self._sequence, time, kind, content))
        self._sequence += 1

    def restart(self, sequence: int) -> None:
        """Discard the entries since the last ``drain``, and give the next one this number."""
        self._sequence = sequence
        self._entries.clear()

    def drain(self) -> list[JournalEntry]:
        """Return the entries since the last call."""
        entries, self._entries = self._entries, []
        return entries
