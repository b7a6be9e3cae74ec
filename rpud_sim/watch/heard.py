"""What has been heard of a drill: the latest of everything, and bounded series."""

from __future__ import annotations

import json
import math
from collections import deque
from contextlib import suppress
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.watch.bins import Rows
from rpud_sim.watch.picture import (
    COLUMNS,
    STATUS_COLUMNS,
    FaultView,
    Impact,
    Mark,
    Section,
    Series,
)

BIN = 50_000_000  # length of a bin of the fast series [ns]

BINS = 1200
STATUSES = 600
_IMPACTS = 100
_MARKS = 200
_TEXT = 200  # characters of a mark

_FIELDS = {
    "nodal_plane": ("position", "velocity"),
    "drill_tool": ("displacement", "velocity", "in_contact"),
    "reacting_force": ("force",),
    "actuator_state": (
        *("voltage", "current", "phase", "impedance", "frequency", "resonance_frequency"),
        *("amplitude", "electrical_power", "mechanical_power", "electrical_energy"),
        *("mechanical_work", "temperature"),
    ),
    "rotation": ("angle", "rate", "torque", "drive_torque", "stalled"),
    "mount": ("position", "feed", "rate", "force", "weight_on_bit", "in_contact", "slip"),
    "borehole": (
        *("depth", "penetration_rate", "layer", "specific_energy", "packed_cuttings"),
        *("bit_wear", "side_offset"),
    ),
}
# Topics of which ``samples`` hears.
SAMPLED = ("nodal_plane", "drill_tool", "reacting_force", "rotation", "mount", "borehole")

_POWER = _FIELDS["actuator_state"].index("electrical_power")
_COLUMN = {name: number for number, name in enumerate(COLUMNS)}


def _band(name: str) -> tuple[int, int]:
    return _COLUMN[f"{name}_min"], _COLUMN[f"{name}_max"]


# Bands of each topic: place among its values, and the columns.
_BANDS = {
    "nodal_plane": ((0, _band("nodal_plane")),),
    "drill_tool": ((0, _band("drill_tool")),),
    "reacting_force": ((0, _band("reacting_force")),),
    "rotation": (
        *((1, _band("rotation_rate")), (2, _band("torque"))),
        (3, _band("drive_torque")),
    ),
    "mount": ((0, _band("mount_position")), (1, _band("feed")), (3, _band("mount_force"))),
    "borehole": ((0, _band("depth")),),
}
_FREE_MASS, _PEAK_FORCE = _band("free_mass"), _band("peak_force")
_TIMES = ("weight_on_bit_applied", "drive_applied", "feed_applied")
_UNMARKED = {"begin", "origin", "flush", "stop", "state"}


class Heard:
    """Latest values and series of one drill; not safe for threads by itself.

    Messages before the journal's stamp of time zero are left out, except the latest status and
    faults, which are kept for that moment.
    """

    def __init__(self) -> None:
        self.run = 0
        self.origin: int | None = None
        self._located = False  # whether the origin is that of the drill that is heard now
        self._kept: dict[str, Any] = {}  # latest latched message by topic
        self.journal_lost: dict[str, int] = {}
        self._journal_next = 0
        self._clear()

    def _clear(self) -> None:
        self.version = getattr(self, "version", 0) + 1
        self.time: float | None = None
        self.status: dict[str, Any] = {}
        self._values: dict[str, tuple[Any, ...]] = {}
        self._impacts: deque[tuple[int, tuple[Any, ...]]] = deque(maxlen=_IMPACTS)
        self.faults: tuple[FaultView, ...] = ()
        self.marks: deque[Mark] = deque(maxlen=_MARKS)
        self._wave: tuple[int, tuple[Any, ...]] | None = None
        self._bins = Rows(len(COLUMNS), BINS)
        self._statuses = Rows(len(STATUS_COLUMNS), STATUSES)

    def restart(self) -> None:
        """Forget the drill: what comes next is of another one, which numbers from zero."""
        self._located = False
        self._kept = {}
        self._journal_next = 0

    # What is heard

    def latched(self, topic: str, message: Any) -> None:
        self.version += 1
        if topic == "journal":
            self._journal(message)
        else:
            self._kept[topic] = message
            if self._located:
                self._show(topic, message)

    def samples(self, topic: str, stamp: int, values: tuple[Any, ...]) -> None:
        """Hear a message of a topic of ``SAMPLED``."""
        row = self._row(stamp)
        if self._located:
            self._values[topic] = values
        if row is not None:
            for place, band in _BANDS[topic]:
                if math.isfinite(values[place]):  # no hole has a depth after a breakthrough
                    _widen(row, band, values[place], values[place])

    def actuator_state(self, stamp: int, values: tuple[Any, ...]) -> None:
        row = self._row(stamp)
        if self._located:
            self._values["actuator_state"] = values
        if row is not None:
            row[_COLUMN["electrical_power"]] = values[_POWER]

    def contact_force(self, stamp: int, values: tuple[Any, ...]) -> None:
        row = self._row(stamp)
        if self._located:
            self._impacts.append((stamp, values))
        if row is not None:
            _widen(row, _PEAK_FORCE, values[1], values[1])
            for name, value in (
                ("impacts", 1.0),
                ("energy", values[5]),
                ("energy_transferred", values[6]),
            ):
                column = _COLUMN[name]
                before = row[column]
                row[column] = value if before != before else before + value

    def waveform(self, stamp: int, values: tuple[Any, ...]) -> None:
        _, period, arrays = values
        length = len(arrays[0])
        if not length or not 0.0 < period < 1e3 or any(len(each) != length for each in arrays):
            return
        self._row(stamp)
        if not self._located or self.origin is None:
            return
        self._wave = stamp, values
        # Bins and blocks are equally long, but begin at different times.
        times = stamp - self.origin + np.arange(length) * (period * SECOND)
        numbers = (times // BIN).astype(np.int64)
        cuts = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), length]
        for first, end in pairwise(cuts):
            row = self._bins.row(int(numbers[first])) if numbers[first] >= 0 else None
            if row is not None:
                part = arrays[2][first:end]
                _widen(row, _FREE_MASS, float(part.min()), float(part.max()))

    # What is shown

    @property
    def latest(self) -> dict[str, dict[str, Any]]:
        return {
            topic: dict(zip(_FIELDS[topic], values, strict=True))
            for topic, values in self._values.items()
        }

    @property
    def impact(self) -> Impact | None:
        if not self._impacts:
            return None
        stamp, values = self._impacts[-1]
        return Impact(self._seconds(stamp), *values)

    @property
    def impacts(self) -> tuple[Impact, ...]:
        """Last impacts, oldest first."""
        return tuple(Impact(self._seconds(stamp), *values) for stamp, values in self._impacts)

    @property
    def section(self) -> Section | None:
        if self._wave is None:
            return None
        stamp, (_, period, arrays) = self._wave
        return Section(self._seconds(stamp), period, *arrays)

    @property
    def series(self) -> Series:
        return Series(self._bins.first, BIN / SECOND, COLUMNS, self._bins.snapshot())

    @property
    def statuses(self) -> Series:
        return Series(self._statuses.first, 0.0, STATUS_COLUMNS, self._statuses.snapshot())

    # Inside

    def _seconds(self, stamp: int) -> float:
        return (stamp - (self.origin or 0)) / SECOND

    def _row(self, stamp: int) -> np.ndarray | None:
        self.version += 1
        if not self._located or self.origin is None or stamp < self.origin:
            return None
        elapsed = stamp - self.origin
        if self.time is None or elapsed > self.time * SECOND:
            self.time = elapsed / SECOND
        return self._bins.row(elapsed // BIN)

    def _journal(self, entry: Any) -> None:
        number = int(entry.sequence)
        missing = number - self._journal_next
        if missing > 0 and self._journal_next:
            self.journal_lost["journal"] = self.journal_lost.get("journal", 0) + missing
        self._journal_next = number + 1
        content: Any = {}
        with suppress(ValueError):  # a stranger may publish there too
            content = json.loads(entry.content)
        if not isinstance(content, dict) or not isinstance(content.get("time"), int):
            return
        stamp = _stamp(entry.header.stamp)
        if entry.kind in ("begin", "restore"):
            self.run += 1
            self._clear()
            if self._located:  # where the clock goes back, what is later belongs to the run before
                self._kept = {
                    topic: message
                    for topic, message in self._kept.items()
                    if _stamp(message.header.stamp) <= stamp
                }
            self._locate(stamp - content["time"])
        elif entry.kind == "origin" and isinstance(content.get("origin"), int):
            self._locate(content["origin"])
        elif not self._located:
            self._locate(stamp - content["time"])
        if entry.kind not in _UNMARKED:
            self.marks.append(Mark(self._seconds(stamp), entry.kind, _text(entry.kind, content)))

    def _locate(self, origin: int) -> None:
        self.origin, self._located = origin, True
        for topic, message in self._kept.items():
            if _stamp(message.header.stamp) >= origin:
                self._show(topic, message)

    def _show(self, topic: str, message: Any) -> None:
        if topic == "status":
            self._status(message)
        else:
            self._faults(message)

    def _status(self, status: Any) -> None:
        stamp = _stamp(status.header.stamp)
        names = [name for name in status.get_fields_and_field_types() if name != "header"]
        fields = {name: getattr(status, name) for name in names}
        for name in _TIMES:
            fields[name] = self._seconds(_stamp(fields[name]))
        self.status = fields
        time = self._seconds(stamp)
        self.time = time if self.time is None else max(self.time, time)
        row = self._statuses.row(self._statuses.end)
        assert row is not None  # a new row is kept
        for column, name in enumerate(STATUS_COLUMNS):
            row[column] = time if name == "time" else float(fields[name])
        if not fields["drive_enabled"]:
            row[STATUS_COLUMNS.index("drive_voltage")] = 0.0

    def _faults(self, faults: Any) -> None:
        self.faults = tuple(
            FaultView(
                number=int(fault.number),
                kind=fault.kind,
                channel=fault.channel,
                magnitude=float(fault.magnitude),
                active=bool(fault.active),
                onset=self._seconds(_stamp(fault.onset)),
                end=None if fault.active else self._seconds(_stamp(fault.clear)),
            )
            for fault in faults.faults
        )


def _widen(row: np.ndarray, band: tuple[int, int], low: float, high: float) -> None:
    """Let a bin contain values; NaN of a faulty signal leaves it as it is."""
    least, most = band
    if not row[least] <= low and low == low:
        row[least] = low
    if not row[most] >= high and high == high:
        row[most] = high


def _stamp(time: Any) -> int:
    return join_seconds(time.sec, time.nanosec)


def _text(kind: str, content: dict[str, Any]) -> str:
    parts = []
    for name, value in content.items():
        if name == "time" or isinstance(value, dict):
            continue
        if isinstance(value, float):
            value = f"{value:g}" if math.isfinite(value) else value
        parts.append(f"{name} {value}")
    for value in content.values():
        if isinstance(value, dict):
            parts += [f"{name} {each}" for name, each in value.items()]
    return f"{kind}: {', '.join(parts)}"[:_TEXT] if parts else kind
