"""Commands and faults of the drills in a bag, in the order in which they were recorded."""

from __future__ import annotations

from collections import defaultdict
from functools import partial
from typing import Any

from rpud_sim.bag import Message
from rpud_sim.viewer.commands import Commands, fault_row
from rpud_sim.viewer.recorded.recording import Recording
from rpud_sim.viewer.recorded.signals import FAULTS, JOURNAL, namespace

MOST_FAULTS = 500  # of a drill; further ones are counted
AT_ONCE = 64  # parts with journals and faults that are read before the page stands


class Marks:
    """Commands and faults that were read so far."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._topics = [
            name
            for name, reader in recording.readers.items()
            if reader.summary.topic.type in (JOURNAL, FAULTS)
        ]
        self.clear()

    def clear(self) -> None:
        """Forget everything: the clocks of the recording have changed."""
        self.commands: dict[str, Commands] = defaultdict(Commands)  # by drill
        self._faults: dict[tuple[str, int, int], dict[str, Any]] = {}  # drill, run, number
        self.unlisted = 0  # faults beyond ``MOST_FAULTS``, and messages of other types
        self.version = 0
        self._next = 0

    def read_next(self) -> bool:
        """Read the next part that holds any; return whether there was one."""
        pieces = self._recording.pieces
        while self._next < len(pieces):
            number, self._next = self._next, self._next + 1
            if not pieces[number].topics.isdisjoint(self._topics):
                for topic in self._topics:
                    for message, decoded in self._recording.decoded(number, topic):
                        self._add(message, decoded)
                self.version += 1
                return True
        return False

    def faults(self, drill: str) -> list[dict[str, Any]]:
        """Return ``faults`` of a frame, in the order of their onsets."""
        found = [fault for (name, _, _), fault in self._faults.items() if name == drill]
        return sorted(found, key=lambda fault: float(fault["onset"]))

    def _add(self, message: Message, decoded: Any) -> None:
        drill = namespace(message.topic)
        try:
            if hasattr(decoded, "faults"):
                self._add_faults(drill, message, decoded)
            else:
                time = self._recording.time_of(message, decoded.header.stamp)
                self.commands[drill].add(time, str(decoded.kind), decoded.content)
        except (AttributeError, TypeError, ValueError):
            self.unlisted += 1  # another type of the same name

    def _add_faults(self, drill: str, message: Message, decoded: Any) -> None:
        jumps = self._recording.clocks[drill].jumps
        run = sum(jump.time <= message.log_time for jump in jumps)
        for fault in decoded.faults:
            key = drill, run, int(fault.number)
            if key not in self._faults and len(self._faults) >= MOST_FAULTS:
                self.unlisted += 1
                continue
            self._faults[key] = fault_row(fault, partial(self._recording.time_of, message))
