"""Content of a drill's own topics for a report: impacts, segments, waveform, faults, journal."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.report.changes import Change, CommandsInForce
from rpud_sim.inspection.report.running_statistics import Envelope, Intervals, Spectrum, usable
from rpud_sim.simulation.statistics import count_events

# Number of journal entries, and of faults, that are kept; further ones are counted.
MOST_ENTRIES = 500

# Channels of a waveform message.
CHANNELS = (
    "nodal_plane_position",
    "actuator_position",
    "free_mass_position",
    "drill_tool_displacement",
    "contact_force",
    "reacting_force",
)

_CLOSER = 1000  # samples of the closer look
_CONTENT = 400  # characters of an entry
_LONGEST_INTERVAL = 10.0  # s; longer ones are pauses

Columns = Mapping[str, np.ndarray]


class Impacts:
    """Impacts on the drill tool, of ``rpud_msgs/ContactForce``."""

    def __init__(self, duration: float) -> None:
        self.intervals = Intervals()  # between consecutive impacts, without pauses [s]
        self.power = Envelope(duration)  # energies of the impacts over time [J]
        self._last: float | None = None

    def add(self, columns: Columns, times: np.ndarray) -> None:
        """Add impacts at times since the bag began [s]."""
        if not len(times):
            return
        steps = np.diff(times, prepend=times[0] if self._last is None else self._last)
        steps = steps[1:] if self._last is None else steps
        self.intervals.add(steps[(steps > 0.0) & (steps < _LONGEST_INTERVAL)])
        self._last = float(times[-1])
        energies = columns["energy"]
        valid = usable(energies)
        self.power.add(times[valid], energies[valid])


@dataclass
class Powers:
    """Mean powers of a drill, of ``rpud_msgs/Status``.

    Each report has the means over the last second. So it counts by the simulation time since the
    report before it, and at most for a second: reports before the start, while paused, or on a
    change of state would distort the mean otherwise. ``optional`` powers count only if every report
    has them, as numbers.
    """

    def __init__(self, names: Sequence[str], optional: Sequence[str] = ()) -> None:
        self._names = tuple(names)
        self._optional = tuple(optional)
        self._joules = np.zeros(len(self._names) + len(self._optional))
        self._seconds = 0.0
        self._last: int | None = None

    def add(self, columns: Columns, times: np.ndarray) -> None:
        stamps = columns["header.stamp"].astype(np.int64)
        if not len(stamps):
            return
        first = stamps[0] if self._last is None else self._last
        seconds = np.clip(np.diff(stamps, prepend=first) / SECOND, 0.0, 1.0)
        self._last = int(stamps[-1])
        values = np.column_stack([columns[name].astype(float) for name in self._names])
        valid = np.asarray(usable(values).all(axis=1))
        if self._optional:
            values = self._with_optional(columns, values, valid)
        self._joules += seconds[valid] @ values[valid]
        self._seconds += float(seconds[valid].sum())

    def _with_optional(self, columns: Columns, values: np.ndarray, valid: np.ndarray) -> np.ndarray:
        """Return values with those of the optional powers, which are given up if one lacks."""
        if all(name in columns and columns[name].dtype.kind == "f" for name in self._optional):
            more = np.column_stack([columns[name] for name in self._optional])
            if usable(more[valid]).all():
                return np.column_stack([values, more])
        self._optional = ()
        self._joules = self._joules[: len(self._names)]
        return values

    @property
    def seconds(self) -> float:
        """Time that the reports span [s]."""
        return self._seconds

    def means(self) -> dict[str, float]:
        """Return the mean of each power [W]; empty if the reports span no time."""
        if not self._seconds > 0.0:
            return {}
        names = (*self._names, *self._optional)
        return dict(zip(names, (self._joules / self._seconds).tolist(), strict=True))


class Segments:
    """Sums over the exact trajectory, of ``rpud_msgs/Trajectory``."""

    duration: float = 0.0  # of all segments [s]
    events: int = 0  # impacts and ends of contacts
    actuator_impacts: int = 0  # of the actuator on the free mass

    def add(self, columns: Columns, times: np.ndarray) -> None:
        """Add segments; their times are not needed."""
        durations = columns["duration"]
        self.duration += float(durations[np.isfinite(durations)].sum())
        events, actuator_impacts = count_events(columns["event"])
        self.events += events
        self.actuator_impacts += actuator_impacts


class Waveform:
    """Spectra and a few samples of the waveform, of ``rpud_msgs/Waveform``."""

    def __init__(self, duration: float) -> None:
        # of ``CHANNELS``, since the last change of their rate
        self.spectrum = Spectrum(len(CHANNELS))
        self.rate = 0.0  # of the samples [Hz]; 0 before the first
        # consecutive samples of each channel, and their ``times`` since the bag began [s]
        self.closer: dict[str, np.ndarray] = {}
        self._middle = 0.5 * duration
        self._next: int | None = None

    def add(self, columns: Columns, times: np.ndarray) -> None:
        """Add samples at times since the bag began [s]."""
        if not len(times):
            return
        numbers = columns["sequence"].astype(np.int64)
        periods = columns["sample_period"]
        samples = np.array([columns[name] for name in CHANNELS])
        cuts = np.flatnonzero((np.diff(numbers) != 1) | (np.diff(periods) != 0.0)) + 1
        for start, end in pairwise([0, *cuts.tolist(), len(numbers)]):
            part = samples[:, start:end]
            rate = 1.0 / float(periods[start])
            if rate != self.rate:
                self.spectrum, self.rate = Spectrum(len(CHANNELS)), rate
            readable = usable(part).all()
            if numbers[start] != self._next or not readable:
                self.spectrum.gap()
            if readable:
                self.spectrum.add(part)
            self._next = int(numbers[end - 1]) + 1
        self._keep_closer(columns, times)

    def _keep_closer(self, columns: Columns, times: np.ndarray) -> None:
        after = np.flatnonzero(times >= self._middle)
        if not self.closer and len(after):
            shown = slice(int(after[0]), int(after[0]) + _CLOSER)
            self.closer = {name: columns[name][shown].copy() for name in CHANNELS}
            self.closer["times"] = times[shown].copy()


@dataclass
class Fault:
    """Fault with its times since the bag began [s]; ``clear`` is None while it is active."""

    number: int
    kind: str
    channel: str
    magnitude: float
    onset: float
    clear: float | None


@dataclass
class FaultLog:
    """Log of all faults, of ``rpud_msgs/Faults``."""

    # last state of each, by number of clock jumps before it and number of the fault
    faults: dict[tuple[int, int], Fault] = field(default_factory=dict)
    unlisted: int = 0  # number of reported states that are not kept

    def add(self, columns: Columns, times: np.ndarray, jumps: int) -> None:
        """Add messages at times since the bag began [s]; numbers of faults restart at a reset."""
        for stamp, time, faults in zip(
            columns["header.stamp"], times, columns["faults"], strict=True
        ):
            for state in faults:
                try:
                    fault = _to_fault(state, int(stamp), float(time))
                except (KeyError, TypeError, ValueError):  # another type of the same name
                    self.unlisted += 1
                    continue
                key = (jumps, fault.number)
                if key in self.faults or len(self.faults) < MOST_ENTRIES:
                    self.faults[key] = fault
                else:
                    self.unlisted += 1


def _to_fault(state: Mapping[str, Any], stamp: int, time: float) -> Fault:
    """Return a fault from a message with this stamp [ns], at a time since the bag began [s]."""

    def since(moment: Mapping[str, int]) -> float:
        return time - (stamp - moment["sec"] * SECOND - moment["nanosec"]) / SECOND

    return Fault(
        int(state["number"]),
        str(state["kind"]),
        str(state["channel"]),
        float(state["magnitude"]),
        since(state["onset"]),
        None if state["active"] else since(state["clear"]),
    )


@dataclass
class Journal:
    """Journal of the changes of a simulation, of ``rpud_msgs/JournalEntry``."""

    # time since the bag began [s], kind, content
    entries: list[tuple[float, str, str]] = field(default_factory=list)
    parameters: dict[str, Any] = field(default_factory=dict)  # of the first simulation
    # number of entries that are not kept. Among these are commands of a feed that make no
    # clear change, which a controller may send 100 times a second.
    unlisted: int = 0
    _in_force: CommandsInForce = field(default_factory=CommandsInForce)

    @property
    def changes(self) -> Sequence[Change]:
        return self._in_force.changes

    def add(self, columns: Columns, times: np.ndarray) -> None:
        """Add entries at times since the bag began [s]."""
        for time, kind, content in zip(times, columns["kind"], columns["content"], strict=True):
            if kind == "begin" and not self.parameters:
                self.parameters = _parameters(content)
            change = self._in_force.take(float(time), str(kind), content)
            if len(self.entries) >= MOST_ENTRIES or (kind == "feed" and change is None):
                self.unlisted += 1
                continue
            cut = "…" if len(content) > _CONTENT else ""
            self.entries.append((float(time), str(kind), content[:_CONTENT] + cut))


def _parameters(content: str) -> dict[str, Any]:
    try:
        return dict(json.loads(content)["parameters"])
    except (KeyError, RecursionError, TypeError, ValueError):
        return {}  # another program wrote it
