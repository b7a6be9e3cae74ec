"""Journal of a run: the plan that was carried out, every change from outside.

The content of an entry is one JSON object. Python writes floats with enough digits to read the same
bits back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class JournalEntry:
    """Entry of a journal: one change from outside."""

    sequence: int  # counts the entries from zero
    time: int  # simulation time of the change [ns]
    kind: str  # one of the KIND constants of ``rpud_msgs/JournalEntry``
    content: Mapping[str, Any]  # details of the kind, by name

    @property
    def text(self) -> str:
        return json.dumps({"time": self.time, **self.content})


class Journal:
    """Queue of the entries of runs, in order, with the number of the first one."""

    def __init__(self, first: int = 0) -> None:
        self.count = first  # number of the next entry; read-only
        self._entries: list[JournalEntry] = []

    def record(self, time: int, kind: str, content: Mapping[str, Any]) -> None:
        """Append an entry for a change at a simulation time [ns]."""
        last = self._entries[-1] if self._entries else None
        if kind == "origin" and last and (last.kind, last.time) == (kind, time):
            self._entries.pop()  # nothing was published under it
            self.count -= 1
        self._entries.append(JournalEntry(self.count, time, kind, content))
        self.count += 1

    def drain(self) -> list[JournalEntry]:
        """Return the entries since the last call."""
        entries, self._entries = self._entries, []
        return entries
