"""History of the current run of a running drill, fed by its topics."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.messages.batch import Batch
from rpud_sim.ros.client.topics import FIELDS
from rpud_sim.ros.graph import message_class
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import Bins
from rpud_sim.viewer.borehole import hole_of
from rpud_sim.viewer.history import MOTION, SECTION, History, Signal, plain_status

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
_REPORTS = ("power", "timing", "status")
_TOPICS = {TOPICS[name].type.rpartition("/")[2]: name for name in (*FIELDS, *_REPORTS)}
_SIGNALS = tuple(
    Signal(_TOPICS[kind], TOPICS[_TOPICS[kind]].type, field)
    for source in (*_COUNTED, *(s for each in QUANTITIES.values() for s in each.sources))
    for kind, _, field in (source.partition("."),)
    # Not what only older bags have.
    if field in message_class(TOPICS[_TOPICS[kind]].type).get_fields_and_field_types()
)

Block = tuple[float, float, tuple[np.ndarray, ...]]  # begin [s], sample period [s], samples


class LiveHistory(History):
    """History of the current run of a drill; not safe for threads by itself.

    Fast messages wait in lists until ``settle``. A message is of the last run that had begun when
    it was published. Messages before the journal's stamp of time zero are left out, except the
    latest reports and faults, which are kept for that moment.
    """

    live = True
    most = 60_000

    def __init__(self) -> None:
        self.run = 0
        self.journal_lost = 0
        self._lost: dict[str, int] = {}  # messages by topic that were lost before
        self._kept: dict[str, tuple[Any, int]] = {}  # latest latched message by topic, and when
        self._begins: dict[int, int] = {}  # when each begin that is not taken in was published [ns]
        self._begun = 0  # when the run's begin was published [ns]; 0 if it is not known
        self._journal_next = 0
        self.held: list[Any] = []  # entries whose run is not known until others are there
        # Of each message: its stamp [ns], its values, and when it was published [ns].
        self._waiting: dict[str, list[tuple[int, tuple[Any, ...], int]]] = {
            topic: [] for topic in (*FIELDS, "waveform")
        }
        super().__init__("", _SIGNALS, ())

    def clear(self, _: object = ()) -> None:
        names = [signal.name for signal in _SIGNALS]
        super().clear([Bins(names, BIN, _BINS, newest=True), Bins(names, BIN, _BINS)])
        # Of the run: stamps from which on an origin counts, ascending, and the origins [ns].
        self._origins: list[tuple[int, int]] = []
        self.reports: dict[str, dict[str, Any]] = {}  # latest status, power and timing
        self.latest_impacts: deque[tuple[float, float, float]] = deque(maxlen=_LATEST_IMPACTS)
        # Of the waveform: the newest whose impacts arrived too, and the newest of all.
        self.block: Block | None = None
        self._newest: Block | None = None
        self._latest: dict[str, tuple[Any, ...]] = {}
        self._holes: dict[str, list[tuple[float, float]]] = {}  # lost messages by topic [s]
        self._until: dict[str, float] = {}  # latest time by topic [s]
        for waiting in self._waiting.values():
            waiting[:] = [each for each in waiting if each[-1] >= self._begun > 0]

    def restart(self) -> None:
        """Forget the drill: what comes next is of another one, which numbers from zero."""
        self._origins = []
        self._kept = {}
        self._begins = {}
        self._begun = 0
        self.held = []
        self._journal_next = 0

    def sinks(self) -> dict[str, Callable[..., object]]:
        """Return, by topic, a function that keeps what ``FastTopics`` gives for ``settle``."""

        def keep(waiting: list[tuple[int, tuple[Any, ...], int]], *message: Any) -> None:
            waiting.append(message)

        return {topic: partial(keep, waiting) for topic, waiting in self._waiting.items()}

    def latched(self, topic: str, message: Any, published: int = 0) -> None:
        """Take in a message of a latched topic, and when it was published [ns]; 0: not known."""
        self._changes += 1
        if topic == "journal" and message.kind == "begin":
            self._begins[message.sequence] = published
        if topic == "journal" and (self.held or (message.sequence and not self._journal_next)):
            self.held.append(message)
        elif topic == "journal":
            self._journal(message)
        elif published >= self._begun:
            self._kept[topic] = message, published
            if self._origins:
                self._show(topic, message)

    def complete(self, entries: Iterable[Any]) -> None:
        """Take in entries of the journal that come before those which are held, in order."""
        for entry in entries:
            self._journal(entry)

    def release(self) -> None:
        """Take in the entries that are held."""
        held, self.held = self.held, []
        self.complete(held)

    def settle(self, lost: Mapping[str, int] = MappingProxyType({})) -> None:
        """Take in the fast messages that wait; ``lost`` counts those that never came, by topic."""
        newest = self._newest
        # Impacts have a topic, a beginning and delays of their own.
        joined = self.since < 2.0 * BIN or (newest and newest[0] > self.since + _JOINING)
        if newest is not self.block and joined:
            self.block = newest
            self._changes += 1
        for topic, waiting in self._waiting.items():
            own = [each for each in waiting if each[-1] >= self._begun]
            if own and self._origins:
                self._settle(topic, own, lost.get(topic, 0) - self._lost.get(topic, 0))
                self._lost[topic] = lost.get(topic, 0)
            waiting.clear()

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """Latest values of the fast topics and of power and timing: by topic, by field."""
        latest = self._latest.items()
        fast = {topic: dict(zip(FIELDS[topic], values, strict=True)) for topic, values in latest}
        return fast | {name: self.reports[name] for name in self.reports if name != "status"}

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
            name: array[first::stride].astype(np.float32)
            for name, array in zip(MOTION, arrays, strict=False)
        }
        impacts = [[at - start, *rest] for at, *rest in self.latest_impacts if start <= at < end]
        return {**samples, "time": start, "period": period * stride, "impacts": impacts}

    def _settle(
        self, topic: str, waiting: list[tuple[int, tuple[Any, ...], int]], lost: int
    ) -> None:
        stamps, messages, _ = zip(*waiting, strict=True)
        times = self._times(np.array(stamps, np.int64))
        if times[-1] < 0:
            return
        if not self._latest and self._newest is None:
            self.since = max(0.0, float(times[0]) / SECOND)
        self.time = max(self.time or 0.0, float(times[-1]) / SECOND)
        if lost > 0:  # where the step between two messages is longest
            known = np.array([self._until.get(topic, self.since), *(times / SECOND)])
            place = int(np.argmax(np.diff(known)))
            self._holes.setdefault(topic, []).append((known[place], known[place + 1]))
        self._until[topic] = float(times[-1]) / SECOND
        if topic == "waveform":
            self._wave(times / SECOND, messages)
            return
        self._latest[topic] = messages[-1]
        fields = dict(zip(FIELDS[topic], zip(*messages, strict=True), strict=True))
        if topic == self.struck:
            impacts = times / SECOND, fields["peak_force"], fields["contact_duration"]
            self.latest_impacts.extend(zip(*impacts, strict=True))
        drawn = {name: each for name, each in fields.items() if f"{topic} {name}" in self.signals}
        columns = {name: np.array(each, float) for name, each in drawn.items()}
        self.add(Batch(topic, times, columns))

    def _wave(self, times: np.ndarray, messages: tuple[tuple[Any, ...], ...]) -> None:
        self._changes += 1
        for begin, (_, period, arrays) in zip(times.tolist(), messages, strict=True):
            length = len(arrays[0])
            if not (length and 0.0 < period < 1.0 and all(len(each) == length for each in arrays)):
                continue
            if self._newest is not None and length * period < SECTION:  # a pause has cut it
                before, _, earlier = self._newest
                if abs(before + len(earlier[0]) * period - begin) < period:
                    earlier = tuple(each[-round(SECTION / period) :] for each in earlier)
                    begin -= len(earlier[0]) * period
                    arrays = tuple(map(np.concatenate, zip(earlier, arrays, strict=True)))
            self._newest = begin, period, arrays

    def _times(self, stamps: np.ndarray) -> np.ndarray:
        """Return the simulation times of stamps, both (n,) [ns]."""
        edges, origins = np.array(self._origins).T
        return stamps - origins[np.maximum(np.searchsorted(edges, stamps, "right") - 1, 0)]

    def _journal(self, entry: Any) -> None:
        number = int(entry.sequence)
        published = self._begins.pop(number, 0)
        if self._journal_next:
            self.journal_lost += max(0, number - self._journal_next)
        self._journal_next = number + 1
        content: Any = {}
        with suppress(RecursionError, ValueError):  # another program may publish there too
            content = json.loads(entry.content)
        time = content.get("time") if isinstance(content, dict) else None
        if not isinstance(time, int) or abs(time) > _GREATEST:
            return
        stamp = _stamp(entry)
        origin = stamp - time
        if entry.kind == "begin":
            self._begun = published
            kept = self._kept.items()
            self._kept = {topic: latest for topic, latest in kept if latest[1] >= published}
            self.run += 1
            self.clear()
        if not self._origins or self.time is None:
            self._origins = [(stamp, origin)]
            for topic, (message, _) in self._kept.items():
                if _stamp(message) >= origin:
                    self._show(topic, message)
        elif origin != self._origins[-1][1]:  # the run continues with other stamps
            self._origins = [each for each in self._origins if each[0] < stamp]
            self._origins.append((stamp, origin))
            self.time = min(self.time, time / SECOND)
        self.add_entry(time / SECOND, entry.kind, content)

    def _show(self, topic: str, message: Any) -> None:
        stamp = _stamp(message)
        times = self._times(np.array([stamp]))
        origin = stamp - int(times[0])
        if topic == "faults":
            self.add_faults(self.run, message.faults, origin)
            return
        if topic == "command_results":
            self.log_version += 1
            for result in message.results[message.repeated :]:
                if not result.accepted:
                    self.commands.refuse(float(times[0]) / SECOND, result.reason)
            return
        names = message.get_fields_and_field_types()
        shown = plain_status({name: getattr(message, name) for name in names}, origin)
        self.reports[topic] = shown
        self.time = max(self.time or 0.0, float(times[0]) / SECOND)
        columns = {
            name: np.array([value], float)
            for name, value in shown.items()
            if f"{topic} {name}" in self.signals
        }
        self.add(Batch(topic, times, columns))


def _stamp(message: Any) -> int:
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec)
