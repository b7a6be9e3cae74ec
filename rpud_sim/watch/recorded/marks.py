"""Marks of a bag on its time: commands of the journal, faults, and gaps."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.pages.plot import COMMAND, FAULT, GAP, Mark
from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.signals import namespace

JOURNAL, FAULTS = "rpud_msgs/msg/JournalEntry", "rpud_msgs/msg/Faults"

MOST_MARKS = 500  # number of marks of a kind; further ones are counted
AT_ONCE = 64  # parts with marks that are read before the page stands

# Entries that the drill writes for itself, and that change nothing.
_QUIET = ("flush", "stop", "origin", "save", "state")
_TEXTS = {
    "begin": "a run begins",
    "end": "the drill stopped",
    "restore": "checkpoint restored",
    "clear_all": "all faults cleared",
}
_CONTENT = 120  # characters of an entry


@dataclass(frozen=True)
class _FaultKey:
    drill: str
    run: int
    number: int


class Marks:
    """Marks that were found so far; several threads may read them."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._lock = threading.Lock()
        self._commands: dict[tuple[str, int], Mark] = {}
        self._faults: dict[_FaultKey, Mark] = {}
        self._gaps: tuple[Mark, ...] = ()
        # marks beyond ``MOST_MARKS`` of a kind, and messages that cannot be understood
        self.unlisted = 0
        self._codecs = {
            name: Codec(reader.summary.topic.type, reader.summary.definition or "")
            for name, reader in recording.readers.items()
            if reader.summary.topic.type in (JOURNAL, FAULTS)
        }
        self.left = [
            number
            for number, piece in enumerate(recording.pieces)
            if not piece.topics.isdisjoint(self._codecs)
        ]

    def read_first(self) -> None:
        """Read the first and the last parts that hold marks."""
        half = AT_ONCE // 2
        chosen = self.left if len(self.left) <= AT_ONCE else self.left[:half] + self.left[-half:]
        self.read(chosen)

    def read(self, numbers: Iterable[int]) -> None:
        """Read parts of the bag; each is read once."""
        for number in list(numbers):
            if number not in self.left:
                continue
            for message in self._recording.messages(number, tuple(self._codecs)):
                self._add(message)
            self.left.remove(number)

    def set_gaps(self, gaps: Sequence[tuple[float, float]]) -> None:
        """Replace the gaps by these, from and to [s since the bag began]."""
        marks = tuple(
            Mark(GAP, start, f"no messages for {end - start:.3g} s", end) for start, end in gaps
        )
        with self._lock:
            self._gaps = marks[:MOST_MARKS]

    def of(self, drill: str) -> list[Mark]:
        """Return the marks of a drill in the order of their times, with all gaps."""
        with self._lock:
            commands = [mark for (name, _), mark in self._commands.items() if name == drill]
            faults = [mark for key, mark in self._faults.items() if key.drill == drill]
            found = [*commands, *faults, *self._gaps]
        return sorted(found, key=lambda mark: mark.time)

    def _add(self, message: Message) -> None:
        kind = self._recording.readers[message.topic].summary.topic.type
        try:
            decoded = self._codecs[message.topic].decode(message.data)
            if kind == JOURNAL:
                self._add_entry(message, decoded)
            else:
                self._add_faults(message, decoded)
        except (AttributeError, BagFormatError, TypeError, ValueError):
            self.unlisted += 1  # another type of the same name

    def _add_entry(self, message: Message, entry: Any) -> None:
        kind = str(entry.kind)
        if kind in _QUIET:
            return
        drill = namespace(message.topic)
        stamp = join_seconds(entry.header.stamp.sec, entry.header.stamp.nanosec)
        mark = Mark(COMMAND, self._time(drill, stamp, message), _entry_text(kind, entry.content))
        key = drill, (message.log_time << 20) + int(entry.sequence) % (1 << 20)
        with self._lock:
            if len(self._commands) < MOST_MARKS:
                self._commands[key] = mark
            else:
                self.unlisted += 1

    def _add_faults(self, message: Message, decoded: Any) -> None:
        drill = namespace(message.topic)
        clock = self._recording.clocks[drill]
        run = sum(jump.log_time <= message.log_time for jump in clock.jumps)
        for fault in decoded.faults:
            key = _FaultKey(drill, run, int(fault.number))
            onset = self._time(drill, join_seconds(fault.onset.sec, fault.onset.nanosec), message)
            clear = None
            if not fault.active:
                clear = self._time(
                    drill, join_seconds(fault.clear.sec, fault.clear.nanosec), message
                )
            where = f" of {fault.channel}" if fault.channel else ""
            size = float(fault.magnitude)
            much = f" {size:g}" if size and math.isfinite(size) else ""
            mark = Mark(FAULT, onset, f"{fault.kind}{where}{much}", clear)
            with self._lock:
                known = self._faults.get(key)
                if known is not None and known.end is not None:
                    mark = replace(mark, end=known.end)  # an earlier message, read later
                if known is not None or len(self._faults) < MOST_MARKS:
                    self._faults[key] = mark
                else:
                    self.unlisted += 1

    def _time(self, drill: str, stamp: int, message: Message) -> float:
        clock = self._recording.clocks[drill]
        if clock.zero is None:
            return (message.log_time - self._recording.begin) / SECOND
        return (stamp - clock.offset(message.log_time)) / SECOND


def _entry_text(kind: str, content: str) -> str:
    if kind in _TEXTS:
        return _TEXTS[kind]
    try:
        values = dict(json.loads(content))
    except (RecursionError, TypeError, ValueError):
        return f"{kind} {content:.{_CONTENT}}"
    values.pop("time", None)
    parameters = values.get("parameters")
    if isinstance(parameters, dict):
        values = parameters
    shown = ", ".join(f"{name} {_short(value)}" for name, value in values.items())
    text = f"{kind.replace('_', ' ')}: {shown}" if shown else kind.replace("_", " ")
    return text if len(text) <= _CONTENT else f"{text[:_CONTENT]}…"


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else f"{value}"
