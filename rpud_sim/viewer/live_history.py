"""History of the current run of a running drill, fed by its topics."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, Topic, TopicSummary
from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.foundation.values import to_float32
from rpud_sim.messages.batch import LATEST, Batch
from rpud_sim.messages.definitions import find_definition
from rpud_sim.recorded.drill_tables import drill_table
from rpud_sim.recorded.journal import RecordedEntry
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.recorded.streams import stamps_of
from rpud_sim.simulation.changes import ChangeError
from rpud_sim.simulation.plan import JournalEntry, StrataTexts, strata_entry
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import Bins
from rpud_sim.viewer.borehole import hole_of
from rpud_sim.viewer.history import MOTION, SECTION, History, Signal, plain_status, seconds
from rpud_sim.viewer.topic_reader import TopicReader

BIN = 0.05  # length of the finest bins [s]
_BINS = 1 << 14
_GREATEST = 2**61  # size of a time with which all calculations fit int64 [ns]
_JOINING = 0.2  # after the first message, in which other topics may not have arrived yet [s]
_LATEST_IMPACTS = 8192  # whose durations are kept: half a second of the densest
_SILENCE = 2.0  # of a topic in which others continue: its messages are missing [s]
_MOST_SAMPLES = 1200  # of a section
_ALWAYS = (  # quantities that each drill has, also before the first message or impact
    *("peak_force", "impact_rate", "reacting_force"),
    *("nodal_plane", "free_mass", "drill_tool"),
)
_COUNTED = ("Status.impacts", "Status.commands_lost")  # beyond the table of quantities
REPORTS = ("power", "timing")  # besides those that every client has
FAST = (
    *("nodal_plane", "drill_tool", "reacting_force", "contact_force", "actuator_state"),
    *("rotation", "mount", "borehole", "waveform"),
)


def _reader(topic: str) -> TopicReader:
    kind = TOPICS[topic].type
    summary = TopicSummary(Topic(topic, kind), 0, None, None, find_definition(kind))
    return TopicReader(summary, drill_table(kind).columns, 1000)


_READERS = {topic: _reader(topic) for topic in (*FAST, *REPORTS, "status")}
_DRAWN = {*_COUNTED, *(source for each in QUANTITIES.values() for source in each.sources)}
_SIGNALS = tuple(
    signal for each in _READERS.values() for signal in each.signals if signal.source in _DRAWN
)

Block = tuple[float, float, tuple[np.ndarray, ...]]  # begin [s], sample period [s], samples


class LiveHistory(History):
    """History of the current run of a drill; not safe for threads by itself.

    A message is of the last run that had begun when it was published, as in a bag. Those of before
    are left out, except the latest reports and faults, which are kept for the run's beginning.
    """

    live = True
    most = 60_000

    def __init__(self) -> None:
        self.journal_lost = 0
        self._lost: dict[str, int] = {}  # messages by topic that were lost before
        self._numbers = 0  # of runs
        self.restart()
        super().__init__("", _SIGNALS, ())

    def clear(self, _: object = ()) -> None:
        names = [signal.name for signal in _SIGNALS]
        super().clear([Bins(names, BIN, _BINS, newest=True), Bins(names, BIN, _BINS)])
        self.reports: dict[str, dict[str, Any]] = {}  # latest status, power and timing
        self.latest_impacts: deque[tuple[float, float, float]] = deque(maxlen=_LATEST_IMPACTS)
        # Of the waveform: the newest whose impacts arrived too, and the newest of all.
        self.block: Block | None = None
        self._newest: Block | None = None
        self._latest: dict[str, dict[str, float]] = {}
        self._holes: dict[str, list[tuple[float, float]]] = {}  # lost messages by topic [s]
        self._until: dict[str, float] = {}  # latest time by topic [s]

    def restart(self) -> None:
        """Forget the drill: what comes next is of another one, which numbers from zero."""
        self._run: RecordedRun | None = None  # with the entries that set its origins
        # Topic, message and publishing time [ns] of reports: those that wait, and the latest.
        self._reports: list[tuple[str, Any, int]] = []
        self._kept: dict[str, tuple[str, Any, int]] = {}
        # Entries, and publishing times, whose run is not known until others are there.
        self.held: list[tuple[Any, int]] = []
        self._journal_next = 0
        self._strata = StrataTexts()

    @property
    def run(self) -> int:
        """Number of the run since the first drill was found; 0 before it."""
        return self._numbers

    def latched(self, topic: str, message: Any, published: int) -> None:
        """Take in a message of a latched topic, and when it was published [ns]."""
        self._changes += 1
        if topic != "journal":
            self._kept[topic] = topic, message, published
            self._reports.append(self._kept[topic])
        elif self.held or (message.sequence and not self._journal_next):
            self.held.append((message, published))
        else:
            self._journal(message, published)

    @property
    def needed(self) -> int:
        """Number of the first entry that the held ones need, a begin and the strata of its run."""
        for entry, _ in self.held:
            if entry.kind == "begin":
                strata = strata_entry(_content_of(entry))
                return int(entry.sequence) if strata is None else strata
        return 0

    def complete(self, entries: Iterable[Any]) -> None:
        """Take in entries of the journal that come before those which are held, in order."""
        for entry in entries:
            self._journal(entry, 0)

    def release(self) -> None:
        """Take in the entries that are held."""
        held, self.held = self.held, []
        for entry, published in held:
            self._journal(entry, published)

    def settle(
        self, batches: Iterable[Batch] = (), lost: Mapping[str, int] = MappingProxyType({})
    ) -> None:
        """Take in the reports that wait, and fast messages.

        ``lost`` counts those that never came, by topic.
        """
        newest = self._newest
        # Impacts have a topic, a beginning and delays of their own.
        joined = self.since < 2.0 * BIN or (newest and newest[0] > self.since + _JOINING)
        if newest is not self.block and joined:
            self.block = newest
            self._changes += 1
        waiting, self._reports = self._reports, []
        if self._run is None:
            return
        for topic, message, published in waiting:
            times = np.array([published])
            if self._run.holds(times)[0]:
                self._show(topic, message, int(self._run.origins(times)[0]))
        for part in self._run.of(batches):
            self._take(part, lost.get(part.topic, 0) - self._lost.get(part.topic, 0))
            self._lost[part.topic] = lost.get(part.topic, 0)

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """Latest values of the fast topics and of power and timing: by topic, by field."""
        return self._latest | {n: each for n, each in self.reports.items() if n != "status"}

    def holes(self, signal: Signal) -> list[tuple[float, float]]:
        found = [*self._holes.get(signal.topic, ())]
        now, until = self.time or 0.0, self._until.get(signal.topic, math.inf)
        if signal.topic == self.struck:  # without impacts nothing is lost
            found += super().holes(signal)
        elif until < now - _SILENCE:
            found.append((until, now))
        return sorted(found)

    def has(self, quantity: str) -> bool:
        return quantity in _ALWAYS or super().has(quantity)

    def moment(self, time: float) -> dict[str, Any]:
        return {"values": self.values, "numbers": self.numbers(time)}

    def whole(self) -> dict[str, Any]:
        return {"timeline": self.timeline(), "hole": hole_of(self, self.time or 0.0)}

    def section_key(self, time: float) -> Any:
        return (self.block[0], self.impacts.total) if self.block else None

    def section(self, time: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the end of the newest block."""
        assert self.block
        begin, period, arrays = self.block
        length = len(arrays[0])
        first = max(0, length - max(2, round(SECTION / period)))
        stride = -(-(length - first) // _MOST_SAMPLES)
        start, end = begin + first * period, begin + length * period
        samples = {
            name: to_float32(array[first::stride])
            for name, array in zip(MOTION, arrays, strict=False)
        }
        impacts = [[at - start, *rest] for at, *rest in self.latest_impacts if start <= at < end]
        return {**samples, "time": start, "period": period * stride, "impacts": impacts}

    def _take(self, part: Batch, lost: int) -> None:
        """Take in messages of a fast topic of the run."""
        topic, blocks = part.topic, part.topic == "waveform"
        found = part if blocks else _READERS[topic].read(part)
        times = (stamps_of(part) - part.origin if blocks else found.times) / SECOND
        if not len(times) or times[-1] < 0.0:
            return
        if not self._until:
            self.since = max(0.0, float(times[0]))
        self.time = max(self.time or 0.0, float(times[-1]))
        if lost > 0:  # where the step between two messages is longest
            known = np.array([self._until.get(topic, self.since), *times])
            place = int(np.argmax(np.diff(known)))
            self._holes.setdefault(topic, []).append((known[place], known[place + 1]))
        self._until[topic] = float(times[-1])
        if blocks:
            self._wave(part)
            return
        self._latest[topic] = {name: float(each[-1]) for name, each in found.fields.items()}
        if topic == self.struck:
            columns = (found.fields[name] for name in ("peak_force", "contact_duration"))
            self.latest_impacts.extend(zip(times, *columns, strict=True))
        self.add(found)

    def _wave(self, part: Batch) -> None:
        self._changes += 1
        for number in range(len(part)):
            try:
                message = _READERS["waveform"].codec.decode(part.message(number))
            except BagFormatError:  # another program publishes there too
                continue
            header, _, period, *arrays = vars(message).values()
            begin, length = seconds(header.stamp, part.origin), len(arrays[0])
            if not (length and 0.0 < period < 1.0 and all(len(each) == length for each in arrays)):
                continue
            if self._newest is not None and length * period < SECTION:  # a pause has cut it
                before, _, earlier = self._newest
                if abs(before + len(earlier[0]) * period - begin) < period:
                    earlier = tuple(each[-round(SECTION / period) :] for each in earlier)
                    begin -= len(earlier[0]) * period
                    arrays = [*map(np.concatenate, zip(earlier, arrays, strict=True))]
            self._newest = begin, period, tuple(arrays)

    def _journal(self, entry: Any, published: int) -> None:
        number = int(entry.sequence)
        if self._journal_next:
            self.journal_lost += max(0, number - self._journal_next)
        self._journal_next = number + 1
        content = _content_of(entry)
        time = content.get("time") if isinstance(content, dict) else None
        if not isinstance(time, int) or abs(time) > _GREATEST:
            return
        if entry.kind == "begin":
            with suppress(ChangeError):  # then the entry that the strata are in is shown
                content = self._strata.complete(number, content)
            self._numbers += 1
            self._run = RecordedRun("", "journal", self.run, window=(published, LATEST))
            self.clear()
            self._reports += [each for each in self._kept.values() if each not in self._reports]
        stamp = join_seconds(entry.header.stamp.sec, entry.header.stamp.nanosec)
        self._set_origin(JournalEntry(number, time, "origin", {"origin": stamp - time}), published)
        self.add_entry(time / SECOND, entry.kind, content)

    def _set_origin(self, entry: JournalEntry, published: int) -> None:
        """Count the stamps of what is published from now on from the origin of an entry."""
        run, origin = self._run, entry.content["origin"]
        if run is None or (run.entries and run.origin == origin):
            return
        recorded = RecordedEntry(entry, origin + entry.time, "", published, published)
        self._run = replace(run, entries=(*run.entries, recorded))
        if self.time is not None:  # the run continues with other stamps
            self.time = min(self.time, entry.time / SECOND)

    def _show(self, topic: str, message: Any, origin: int) -> None:
        """Take in a report of the run."""
        time = seconds(message.header.stamp, origin)
        if topic == "faults":
            self.add_faults(self.run, message.faults, origin)
            return
        if topic == "command_results":
            begun = self._run.entries[-1].entry.time / SECOND if self._run else 0.0
            if time < begun and self._run and origin == self._run.origin:
                return  # its origin is an older one, whose entry came without a publishing time
            self.log_version += 1
            for result in message.results[message.repeated :]:
                if not result.accepted:
                    self.commands.refuse(time, result.reason)
            return
        names = message.get_fields_and_field_types()
        shown = plain_status({name: getattr(message, name) for name in names}, origin)
        self.reports[topic] = shown
        self.time = max(self.time or 0.0, time)
        columns = {
            signal.column: np.array([shown[signal.column]], float)
            for signal in _READERS[topic].signals
            if signal.column in shown
        }
        self.add(Batch(topic, np.empty(0), columns, times=np.array([round(time * SECOND)])))


def _content_of(entry: Any) -> Any:
    with suppress(RecursionError, ValueError):  # another program may publish there too
        return json.loads(entry.content)
    return {}
