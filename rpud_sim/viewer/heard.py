"""What was heard of a drill: the latest of everything, and all quantities over the whole run."""

from __future__ import annotations

import json
import math
import re
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from time import monotonic
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import QUANTITIES
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.recorded.run_clock import GREATEST, RunClock
from rpud_sim.ros.client.topics import FIELDS
from rpud_sim.viewer.commands import Commands, fault_row
from rpud_sim.viewer.history import Bins, Impacts
from rpud_sim.viewer.picture import SECTION, TIMES, Picture

BIN = 0.05  # length of the finest bins [s]

_BINS = 1 << 14
_JOINING = 0.2  # after the first message, in which other topics may not be heard yet [s]
_LATEST_IMPACTS = 8192  # whose durations are kept: half a second of the densest
_MOST_EXACT = 60_000  # impacts of a view whose quantiles are computed; more have extremes
_WHOLE_PERIOD = 1.0  # between additions to the bins of the whole run [s of real time]
_ALWAYS = (  # quantities that each drill has, also before the first message or impact
    *("peak_force", "impact_rate", "reacting_force"),
    *("nodal_plane", "free_mass", "drill_tool"),
)

Block = tuple[float, float, tuple[np.ndarray, ...]]  # begin [s], sample period [s], samples
_Sink = Callable[[int, tuple[Any, ...]], object]

# Quantities of each topic by its field; what a status has too is taken from the other topic.
_QUANTITIES: dict[str, dict[str, str]] = {topic: {} for topic in (*FIELDS, "status")}
_OWNERS: dict[str, str] = {}
for _quantity in QUANTITIES.values():
    for _source in _quantity.sources:
        _type, _, _field = _source.partition(".")
        _topic = re.sub("(?<!^)(?=[A-Z])", "_", _type).lower()
        _QUANTITIES[_topic][_field] = _quantity.name
        if _topic != "status":
            _OWNERS[_quantity.name] = _topic
_SIGNALS = tuple({name: None for names in _QUANTITIES.values() for name in names.values()})


class Heard:
    """Latest values and history of one drill; not safe for threads by itself.

    Fast messages wait in lists until ``settle``. Messages before the journal's stamp of time zero
    are left out, except the latest status and faults, which are kept for that moment.
    """

    def __init__(self) -> None:
        self.run = 0
        self.version = 0  # grows with what is heard
        self.log_version = 0  # grows with commands, faults and refusals
        self.journal_lost = 0
        self._clock: RunClock | None = None  # of the run that is heard now
        self._restored: dict[str, Any] = {}  # checkpoint with which it begins
        self._kept: dict[str, Any] = {}  # latest latched message by topic
        self._journal_next = 0
        self._waiting: dict[str, list[tuple[int, tuple[Any, ...]]]] = {
            topic: [] for topic in (*FIELDS, "waveform")
        }
        self._clear()

    def _clear(self) -> None:
        self.version += 1
        self.time: float | None = None  # latest [s]
        self.since: float | None = None  # time of the first fast message that was heard [s]
        self.status: dict[str, Any] = {}
        self.faults: list[dict[str, Any]] = []
        self.commands = Commands()
        self.impacts = Impacts()
        self.latest_impacts: deque[tuple[float, float, float]] = deque(maxlen=_LATEST_IMPACTS)
        self.fine = Bins(_SIGNALS, BIN, _BINS, newest=True)
        self.whole = Bins(_SIGNALS, BIN, _BINS)
        # Of the waveform: the newest whose impacts were heard too, and the newest of all.
        self.block: Block | None = None
        self._newest: Block | None = None
        self._latest: dict[str, tuple[Any, ...]] = {}
        self._pending: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        self._pending_since = 0.0
        for waiting in self._waiting.values():
            waiting.clear()

    def restart(self) -> None:
        """Forget the drill: what comes next is of another one, which numbers from zero."""
        self._clock = None
        self._kept = {}
        self._journal_next = 0

    # What is heard

    def sinks(self) -> dict[str, _Sink]:
        """Return, by topic, a function that keeps stamp and values for ``settle``."""

        def keep(waiting: list[tuple[int, tuple[Any, ...]]], *message: Any) -> None:
            waiting.append(message)

        return {topic: partial(keep, waiting) for topic, waiting in self._waiting.items()}

    def latched(self, topic: str, message: Any) -> None:
        self.version += 1
        if topic == "journal":
            self._journal(message)
        else:
            self._kept[topic] = message
            if self._clock:
                self._show(topic, message, self._clock)

    def refuse(self, reason: str) -> None:
        """Note that the drill has refused a command."""
        self.log_version += 1
        self.commands.refuse(self.time or 0.0, reason)

    def settle(self) -> None:
        """Take in the fast messages that wait."""
        if self._newest is not self.block and self._newest is not None:
            # Impacts have a topic, a beginning and delays of their own.
            since = self.since or 0.0
            if since < 2.0 * BIN or self._newest[0] > since + _JOINING:
                self.block = self._newest
                self.version += 1
        for topic, waiting in self._waiting.items():
            if waiting:
                self.version += 1
                if self._clock:
                    self._settle(topic, waiting, self._clock)
                waiting.clear()
        if monotonic() - self._pending_since >= _WHOLE_PERIOD:
            self._pending_since = monotonic()
            self.version += bool(self._pending)
            for signal, parts in self._pending.items():
                times, values = (np.concatenate(each) for each in zip(*parts, strict=True))
                self.whole.add(signal, times, values)
            self._pending = {}

    def _settle(
        self, topic: str, waiting: list[tuple[int, tuple[Any, ...]]], clock: RunClock
    ) -> None:
        stamps, messages = zip(*waiting, strict=True)
        times = clock.elapsed(np.array(stamps, np.int64), np.zeros(len(stamps)))
        if times[-1] < 0.0:
            return
        self.time = max(self.time or 0.0, float(times[-1]))
        if self.since is None:
            self.since = max(0.0, float(times[0]))
        if topic == "waveform":
            self._wave(times, messages)
            return
        self._latest[topic] = messages[-1]
        for field, quantity in _QUANTITIES[topic].items():
            place = FIELDS[topic].index(field)
            values = np.array([message[place] for message in messages], float)
            if topic == "contact_force":
                valid = (times >= 0.0) & np.isfinite(values)
                self.impacts.add(times[valid], values[valid])
                self.latest_impacts.extend(
                    zip(times, values, (message[2] for message in messages), strict=True)
                )
            self._add(quantity, times, values)

    def _wave(self, times: np.ndarray, messages: tuple[tuple[Any, ...], ...]) -> None:
        for time, (_, period, arrays) in zip(times, messages, strict=True):
            length = len(arrays[0])
            if not (length and 0.0 < period < 1.0 and all(len(each) == length for each in arrays)):
                continue
            begin = float(time)
            if self._newest is not None and length * period < SECTION:  # a pause has cut it
                before, _, earlier = self._newest
                if abs(before + len(earlier[0]) * period - begin) < period:
                    earlier = tuple(each[-round(SECTION / period) :] for each in earlier)
                    begin -= len(earlier[0]) * period
                    arrays = tuple(map(np.concatenate, zip(earlier, arrays, strict=True)))
            self._newest = begin, period, arrays

    def _add(self, quantity: str, times: np.ndarray, values: np.ndarray) -> None:
        if self.is_stepped(quantity):
            return  # its steps say it exactly
        self.fine.add(quantity, times, values)
        self._pending.setdefault(quantity, []).append((times, values))

    # What is shown

    @property
    def values(self) -> dict[str, dict[str, Any]]:
        """Latest values of the fast topics: by topic, by field."""
        return {
            topic: dict(zip(FIELDS[topic], values, strict=True))
            for topic, values in self._latest.items()
        }

    def has(self, quantity: str) -> bool:
        if quantity in _ALWAYS or self.is_stepped(quantity):
            return True
        return quantity in _SIGNALS and self.fine.has(quantity)

    def is_stepped(self, quantity: str) -> bool:
        """Return whether commands say a quantity; the weight on bit of an arm is measured."""
        measured = quantity == "weight_on_bit" and "mount" in self._latest
        return quantity in self.commands.quantities and not measured

    def picture(self, start: float = math.inf) -> Picture:
        """Return what is drawn from a time on [s]: the newest finely, or the whole run."""
        kept = self.fine.first == 0 or start >= self.fine.first * self.fine.width
        bins = self.fine if kept else self.whole
        return Picture(
            bins,
            self.impacts,
            lambda name: name if name in _SIGNALS and self.has(name) else None,
            self.since or 0.0,
            self.time or 0.0,
            most=_MOST_EXACT,
        )

    # Inside

    def _journal(self, entry: Any) -> None:
        number = int(entry.sequence)
        if self._journal_next:
            self.journal_lost += max(0, number - self._journal_next)
        self._journal_next = number + 1
        content: Any = {}
        with suppress(RecursionError, ValueError):  # a stranger may publish there too
            content = json.loads(entry.content)
        time = content.get("time") if isinstance(content, dict) else None
        if not isinstance(time, int) or abs(time) > GREATEST:
            return
        stamp, clock = _stamp(entry.header.stamp), self._clock
        if entry.kind in ("begin", "restore"):
            self.run += 1
            self._clear()
            # Where the clock goes back, a later status belongs to the run before. Faults are not
            # repeated: those may be the newest ones, heard before the journal.
            back, status = clock and stamp - time <= (clock.origin or 0), self._kept.get("status")
            if back and status and _stamp(status.header.stamp) > stamp:
                del self._kept["status"]
            clock = self._clock = None
            if entry.kind == "restore":  # its time is that of the run before
                self._restored = content
                return
        if clock is None or self.time is None:
            clock = self._clock = RunClock(stamp - time)
            clock.add("begin", stamp, time)
            for topic, message in self._kept.items():
                if _stamp(message.header.stamp) >= stamp - time:
                    self._show(topic, message, clock)
        elif clock.add("origin", stamp, time):  # the run goes on with other stamps
            self.time = min(self.time, time / SECOND)
        self.log_version += 1
        if self._restored:
            self.commands.add(clock.seconds(stamp), "restore", self._restored)
            self._restored = {}
        self.commands.add(clock.seconds(stamp), entry.kind, content)

    def _show(self, topic: str, message: Any, clock: RunClock) -> None:
        if topic == "status":
            return self._status(message, clock)
        self.log_version += 1
        self.faults = [
            fault_row(fault, lambda time: clock.seconds(_stamp(time))) for fault in message.faults
        ]
        return None

    def _status(self, status: Any, clock: RunClock) -> None:
        names = [name for name in status.get_fields_and_field_types() if name != "header"]
        fields = {name: getattr(status, name) for name in names}
        for name in TIMES:
            fields[name] = clock.seconds(_stamp(fields[name]))
        self.status = fields
        time = clock.seconds(_stamp(status.header.stamp))
        self.time = max(self.time or 0.0, time)
        for field, quantity in _QUANTITIES["status"].items():
            if _OWNERS.get(quantity) not in self._latest:
                self._add(quantity, np.array([time]), np.array([fields[field]], float))


def _stamp(time: Any) -> int:
    return join_seconds(time.sec, time.nanosec)
