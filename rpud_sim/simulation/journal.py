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
        return json.dumps({"time": self.time, **self.content})


# Kinds of entries at which a run can begin: what follows does not need what was before.
STARTS = ("begin", "state")
# Entries from one of these to the next. A late subscriber gets 1000: so the last 750 at least.
_STATE_PERIOD = 250


class Journal:
    """Journal: a queue of entries, in order; ``states`` says whether states become due."""

    def __init__(self, states: bool = True) -> None:
        self.count = 0  # entries so far, read-only
        self._states = states
        self._since_start = 0
        self._entries: list[JournalEntry] = []

    @property
    def state_due(self) -> bool:
        return self._states and self._since_start >= _STATE_PERIOD

    def note(self, time: int, kind: str, **content: Any) -> None:
        """Append an entry for a change at a simulation time [ns]."""
        last = self._entries[-1] if self._entries else None
        if kind == "origin" and last and (last.kind, last.time) == (kind, time):
            self._entries.pop()  # nothing was published under it
            self.count -= 1
        self._entries.append(JournalEntry(self.count, time, kind, content))
        self.count += 1
        self._since_start = 0 if kind in STARTS else self._since_start + 1

    def restart(self, sequence: int) -> None:
        """Discard the entries since the last ``drain``, and give the next one this number."""
        self.count = sequence
        self._entries.clear()

    def drain(self) -> list[JournalEntry]:
        entries, self._entries = self._entries, []
        return entries
