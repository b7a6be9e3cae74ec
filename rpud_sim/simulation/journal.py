"""Journal of a run: every change from outside, from which the run can be repeated.

The content of an entry is one JSON object. Python writes floats with enough digits to read the same
bits back.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.versions import engine_and_processor


@dataclasses.dataclass(frozen=True)
class JournalEntry:
    """Entry of a journal: one change from outside.

    Args:
        sequence: counts the entries from zero.
        time: simulation time of the change [ns].
        kind: one of the KIND constants of ``rpud_msgs/JournalEntry``.
        content: details of the kind, by name.
    """

    sequence: int
    time: int
    kind: str
    content: Mapping[str, Any]

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

    def begin(
        self,
        parameters: Mapping[str, Any],
        initial_phase: float,
        seed: int,
        scenario: Scenario | None,
    ) -> None:
        """Append the entry of a beginning.

        Args:
            parameters: all values, by name.
            initial_phase: of the vibration [cycles].
            seed: of faulty signals.
            scenario: faults that begin by themselves, as they were drawn.
        """
        faults = [
            {**dataclasses.asdict(planned.fault), "onset": planned.onset, "clear": planned.clear}
            for planned in (scenario.faults if scenario else ())
        ]
        self.note(
            0,
            "begin",
            parameters=dict(parameters),
            initial_phase=initial_phase,
            seed=seed,
            faults=faults,
            made_by=engine_and_processor(),
        )

    def drain(self) -> list[JournalEntry]:
        """Return the entries since the last call."""
        entries, self._entries = self._entries, []
        return entries
