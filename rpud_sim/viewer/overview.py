"""What was read of a bag so far: bins of signals, impacts, commands and faults."""

from __future__ import annotations

import itertools
import json
import math
from collections import defaultdict
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from rpud_sim.bag import Message
from rpud_sim.foundation.time import SECOND
from rpud_sim.viewer.commands import Commands, fault_row
from rpud_sim.viewer.history import Bins, Impacts
from rpud_sim.viewer.picture import GAP, usual
from rpud_sim.viewer.recording import (
    FAULTS_TYPE,
    IMPACTS_TYPE,
    JOURNAL_TYPE,
    PieceRows,
    RecordedBag,
    namespace,
)

BINS = 2**17  # greatest number of bins of a signal
MEMORY = 256 * 2**20  # greatest size of the bins of all signals [bytes]
MOST_FAULTS = 500  # of a bag; further ones are counted
AT_ONCE = 64  # parts with journals and faults that are read before the page stands

_LEAST_BINS = 2**10
_BIN_SIZE = 32  # bytes
_LEAST_GAP = 0.1  # s
_LEAST_STEPS = 10  # fewer messages have no usual distance
_BATCH = 16  # parts that are read together
_SPARE = 1.02  # of the time, for what is later than the last log time


class Overview:
    """Bins of all signals over the whole time of a recording, and the impacts, commands and faults.

    At first it has a sample. ``look`` reads parts anywhere in the bag, ``read_next`` one after the
    other.
    """

    def __init__(self, recording: RecordedBag) -> None:
        self._recording = recording
        # Journals first: they tell the clocks.
        self._marked = [
            name
            for kind in (JOURNAL_TYPE, FAULTS_TYPE)
            for name, reader in recording.readers.items()
            if reader.type == kind
        ]
        self.version = 0  # of commands and faults
        self.commands: dict[str, Commands] = defaultdict(Commands)  # by drill
        self._faults: dict[tuple[str, int, int], dict[str, Any]] = {}  # drill, run, number
        self.unlisted = 0  # faults beyond ``MOST_FAULTS``, and messages of other types
        self._marks = 0  # parts whose commands and faults were read
        self._latest: dict[str, int] = {}  # publishing time of the latest entry by journal
        self.read = 0  # parts that were read in their order
        self._sampled: set[int] = set()  # parts beyond them that were read
        all(self._read_marks() for _ in range(AT_ONCE))  # until there are no more
        self._restart()

    def _restart(self) -> None:
        """Forget all values: a clock has changed."""
        recording = self._recording
        last = recording.rows(len(recording.pieces) - 1) if recording.pieces else {}
        duration = max(recording.end_of(last), 0.0) or self._expected
        names = [signal.name for signal in recording.signals]
        fitting = MEMORY // (_BIN_SIZE * max(1, len(names)))
        count = min(BINS, max(_LEAST_BINS, 2 ** int(math.log2(fitting))))
        self.bins = Bins(names, duration * _SPARE / count, count)
        self.impacts: dict[str, Impacts] = defaultdict(Impacts)  # by drill
        self._seen = 0.0  # latest time of what was read [s]
        self._until = 0.0  # time up to which the parts reach that were read in their order [s]
        self.read = 0
        self._sampled.clear()
        self.look(recording.sample)

    @property
    def _expected(self) -> float:
        return max(self._recording.bag.duration / SECOND, 1e-3)

    @property
    def end(self) -> float:
        """Latest time of what was read [s]."""
        return self._seen or self._expected

    @property
    def complete(self) -> bool:
        return self.read >= len(self._recording.pieces)

    @property
    def share(self) -> float:
        """Part of the bag that was read, from 0 to 1; 1 only if all of it was."""
        if self.complete:
            return 1.0
        ahead = sum(1 for number in self._sampled if number >= self.read)
        return min((self.read + ahead) / len(self._recording.pieces), 0.999)

    @property
    def known(self) -> float:
        """Time up to which no value is missing [s]; infinite if all was read."""
        return math.inf if self.complete else self._until

    def look(self, numbers: Iterable[int]) -> None:
        """Read these parts now, if they were not read yet."""
        if not self.complete:
            for number in {*numbers} - self._sampled:
                if number >= self.read:
                    self._add(self._recording.rows(number))
                    self._sampled.add(number)

    def read_next(self) -> bool:
        """Read the next few parts, those with commands first; return whether there were any."""
        if self._read_marks():
            return True
        if self.complete:
            return False
        recording, numbers = self._recording, self._batch(self.read)
        if self.read in self._sampled:
            found = recording.rows(self.read)
        else:
            found = recording.rows_of(numbers)
            self._add(found)
        self._until = max(self._until, recording.end_of(found))
        self.read += len(numbers)
        return True

    def gaps(self) -> list[tuple[float, float]]:
        """Return where no signal has messages for much longer than usual, from and to [s].

        Only a complete overview knows it: of an incomplete one it returns nothing.
        """
        used, width = self.bins.used(), self.bins.width
        steps = np.diff(used)
        if not self.complete or len(steps) < _LEAST_STEPS:
            return []
        longest = max(GAP * usual(steps), _LEAST_GAP / width)
        return [
            ((int(used[place]) + 1) * width, int(used[place + 1]) * width)
            for place in np.flatnonzero(steps > longest)
        ]

    def faults(self, drill: str) -> list[dict[str, Any]]:
        """Return ``faults`` of a frame, in the order of their onsets."""
        found = [fault for (name, _, _), fault in self._faults.items() if name == drill]
        return sorted(found, key=lambda fault: float(fault["onset"]))

    def _batch(self, first: int) -> list[int]:
        """Return the parts that are read together: a sampled one alone, others until the next."""
        if first in self._sampled:
            return [first]
        rest = range(first, min(first + _BATCH, len(self._recording.pieces)))
        return [*itertools.takewhile(lambda number: number not in self._sampled, rest)]

    def _add(self, found: PieceRows) -> None:
        """Add the rows of parts."""
        recording = self._recording
        for topic, rows in found.items():
            if not len(rows.stamps):
                continue
            times, drill = recording.elapsed(topic, rows), namespace(topic)
            self._seen = max(self._seen, float(times.max()))
            for signal in recording.readers[topic].signals:
                self.bins.add(signal.name, times, rows.values[signal.column])
            if topic == recording.topic(drill, IMPACTS_TYPE) and "peak_force" in rows.values:
                peaks = rows.values["peak_force"]
                valid = np.isfinite(peaks)
                self.impacts[drill].add(times[valid], peaks[valid])

    def _read_marks(self) -> bool:
        """Read the next part with commands or faults; return whether there was one."""
        pieces = self._recording.pieces
        while self._marks < len(pieces):
            number, self._marks = self._marks, self._marks + 1
            if not pieces[number].topics.isdisjoint(self._marked):
                for topic in self._marked:
                    for message, decoded in self._recording.decoded(number, topic):
                        self._mark(namespace(topic), message, decoded)
                self.version += 1
                return True
        return False

    def _mark(self, drill: str, message: Message, decoded: Any) -> None:
        recording = self._recording
        time_of = partial(recording.time_of, message)
        try:
            if hasattr(decoded, "faults"):
                for fault in decoded.faults:
                    key = drill, recording.run(message), int(fault.number)
                    if key in self._faults or len(self._faults) < MOST_FAULTS:
                        self._faults[key] = fault_row(fault, time_of)
                    else:
                        self.unlisted += 1
            elif message.publish_time >= self._latest.get(message.topic, 0):  # no repeated one
                self._latest[message.topic] = message.publish_time
                content = json.loads(decoded.content)
                changed = recording.set_clock(message, decoded, content["time"])
                time = time_of(decoded.header.stamp)
                if changed and self._marks <= max(self.read, *self._sampled, 0):
                    self._restart()
                self.commands[drill].add(time, str(decoded.kind), content)
        # Another type of the same name, or another program wrote it.
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError):
            self.unlisted += 1
