"""What a drill has done: signals in bins, impacts, commands and faults, and how they are drawn."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.foundation.shown_quantities import QUANTITIES, ShownQuantity
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.foundation.values import to_float32
from rpud_sim.messages.batch import Batch
from rpud_sim.simulation.fault_kinds import magnitude_text
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.viewer.bins import CREDIBLE, Bins, Impacts, Layer, gaps_of, with_gaps
from rpud_sim.viewer.commands import Commands

SECTION = 0.02  # length of the motion that a section shows [s]
MOTION = ("nodal_plane", "actuator", "free_mass", "drill_tool", "contact_force")
IMPACTS = ("impact_rate", "peak_force")  # quantities that the impacts themselves show
MOST_FAULTS = 500  # that are shown
_APPLIED = ("weight_on_bit_applied", "drive_applied", "feed_applied", "mount_applied")
IMPACTS_TYPE = TOPICS["contact_force"].type

_POINT = 2  # width of a part of a band [px]
_LEAST_IMPACTS = 8  # in a part of the time that shows their spread
_RATES = 10  # parts of a second, whose rates of impacts are compared
_SPARK = 60  # means of a sparkline, one a second
_TIMELINE = 1000  # bins
_FINEST = 1 << 20  # parts of a range: as many as there are bins
_UNBELIEVABLE = 1e100  # size of a value beyond the table of quantities
_MOST_GARBAGE = 10_000  # values of a signal whose times are kept, the newest
_MOST_HOLES = 200  # of one signal that are shown
_NUMBERS = {  # quantities that a number shows: the first that there is
    "depth": ("depth",),
    "reacting_force": ("reacting_force",),
    "power": ("electrical_power", "actuator_power"),
    "penetration_rate": ("penetration_rate",),
}


@dataclass(frozen=True)
class Signal:
    """Column of numbers of one topic."""

    topic: str  # its name
    type: str  # of its messages
    column: str  # its name
    unit: str = ""  # from the comment in the type; empty without one

    @property
    def name(self) -> str:
        return f"{self.topic} {self.column}"

    @property
    def drill(self) -> str:
        return namespace(self.topic)

    @property
    def source(self) -> str:
        """``Type.column``, as the table of quantities names where a quantity comes from."""
        return f"{self.type.rpartition('/')[2]}.{self.column}"


def namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def is_foreign(topic: str) -> bool:
    """Whether a drill has no topic of this name."""
    return topic.rpartition("/")[2] not in TOPICS


def seconds(stamp: Any, origin: int) -> float:
    """Return the time of a stamp in a message, which counts from an origin [ns]."""
    return (join_seconds(stamp.sec, stamp.nanosec) - origin) / SECOND


def plain_status(fields: Mapping[str, Any], origin: int) -> dict[str, Any]:
    """Return the fields of a status as a frame has them; its stamps count from an origin [ns]."""
    plain = bool | int | float | str | np.generic
    found = {name: value for name, value in fields.items() if isinstance(value, plain)}
    for name in _APPLIED:
        with suppress(AttributeError, LookupError, TypeError):  # another program wrote it
            found[name] = seconds(fields[name], origin)
    return found


class History:
    """What a drill has done up to now; ``add`` takes its messages, from DDS or from a bag.

    Times begin with the run of a drill, or with a bag [s]. ``bins`` hold all signals, the finest
    first; the drills of a bag share them.
    """

    log_version = 0  # grows with commands and faults
    _changes = 0  # grows with the messages
    most = math.inf  # impacts of a range whose quantiles are computed; more have extremes
    known = math.inf  # time up to which no value is missing; only samples beyond it [s]
    samples = 0.0  # beyond it [1/s]

    def __init__(self, drill: str, signals: Iterable[Signal], bins: Iterable[Bins]) -> None:
        self.drill = drill
        self.signals = {signal.name: signal for signal in signals}
        shown = {source: each for each in QUANTITIES.values() for source in each.sources}
        self._credible = {  # greatest sizes of the signals of the table
            signal.name: shown[signal.source].credible
            for signal in self.signals.values()
            if signal.source in shown
        }
        strike = [each.topic for each in self.own_signals if each.type == IMPACTS_TYPE]
        self.struck = min(strike, key=is_foreign, default="")  # topic of the impacts
        self.clear(bins)

    def clear(self, bins: Iterable[Bins]) -> None:
        """Forget everything: another run begins."""
        self.bins = tuple(bins)
        self._changes += 1
        self.log_version += 1
        self.since = 0.0  # time from which on there are messages [s]
        self.time: float | None = None  # latest [s]
        self.impacts = Impacts()
        self.commands = Commands()
        self.garbage: dict[str, deque[float]] = {}  # times of values by signal [s]
        self._commands_lost: dict[
            float, bool
        ] = {}  # whether commands are lost, by the time of a status
        self._faults: dict[tuple[int, int], dict[str, Any]] = {}  # by run and number
        self.unlisted = 0  # faults beyond ``MOST_FAULTS``, and messages that are none of a drill

    def add(self, batch: Batch) -> None:
        """Add the values of messages of a topic, at their times."""
        self._changes += 1
        times = batch.times / SECOND
        for column, values in batch.fields.items():
            if (name := f"{batch.topic} {column}") in self.signals:
                wrong = ~(self.is_credible(self.signals[name], values) | np.isnan(values))
                if wrong.any():
                    kept = self.garbage.setdefault(name, deque(maxlen=_MOST_GARBAGE))
                    kept.extend(times[wrong].tolist())
                    values = np.where(wrong, np.nan, values)
                for bins in self.bins:
                    bins.add(name, times, values)
        for time, lost in zip(times, batch.fields.get("commands_lost", ()), strict=False):
            self._commands_lost[float(time)] = bool(lost)
        peaks = batch.fields.get("peak_force")
        if batch.topic == self.struck and peaks is not None:  # another type may have the name
            valid = np.isfinite(peaks) & (times >= 0.0)
            self.impacts.add(times[valid], peaks[valid])

    def is_credible(self, signal: Signal, values: np.ndarray) -> np.ndarray:
        """Return which values are numbers, and not garbage, shape (n,)."""
        return np.asarray(np.abs(values) <= self._credible.get(signal.name, _UNBELIEVABLE))

    def add_entry(self, time: float, kind: str, content: Any) -> None:
        """Add an entry of the journal, at a time [s]."""
        self.log_version += 1
        self.commands.add(time, kind, content)

    def add_faults(self, run: int, faults: Iterable[Any], origin: int) -> None:
        """Add the faults of a message of a run, whose stamps count from an origin [ns]."""
        self.log_version += 1
        for fault in faults:
            if len(self._faults) >= MOST_FAULTS and (run, int(fault.number)) not in self._faults:
                self.unlisted += 1
                continue
            self._faults[run, int(fault.number)] = {
                "number": int(fault.number),
                "kind": str(fault.kind),
                "channel": str(fault.channel),
                "magnitude": (size := float(fault.magnitude)),
                "size": magnitude_text(str(fault.kind), str(fault.channel), size),
                "onset": seconds(fault.onset, origin),
                "end": None if fault.active else seconds(fault.clear, origin),
                "active": bool(fault.active),
            }

    def log(self) -> dict[str, Any]:
        """Return the fields of a frame with what was commanded."""
        spans: list[tuple[float, float]] = []
        lost = False
        for time, now in sorted(self._commands_lost.items()):
            if now and not lost:
                spans.append((time, math.inf))
            elif lost and not now:
                spans[-1] = spans[-1][0], time
            lost = now
        return self.commands.frame(self.faults, spans)

    @property
    def version(self) -> int:
        """A number that grows with the messages."""
        return self._changes

    # What a screen asks of every drill; a recorded one has more

    live = False  # whether it changes all the time
    is_drill = True  # and not another node

    def range(self, view: Any) -> tuple[float, float]:
        """Return the range of time that a browser shows [s]."""
        now = self.time or 0.0
        return (view.start, view.end) if view.follow is None else (now - view.follow, now)

    def others(self) -> list[ShownQuantity]:
        """Signals beyond the table of quantities."""
        return []

    def moment(self, time: float) -> dict[str, Any]:
        """Return fields of a frame at a time [s]."""
        return {"numbers": self.numbers(time)}

    def whole(self) -> dict[str, Any]:
        """Return fields of a frame that show the whole time."""
        return {"timeline": self.timeline()}

    def view_key(self, start: float, end: float) -> Any:
        """Return what changes when a view of this range does [s]."""
        return self.version

    def section_key(self, time: float) -> Any:
        """Return what changes when the motion until a time does [s]; None without a motion."""
        return None

    def section(self, time: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the motion until a time [s]."""
        return None

    @property
    def own_signals(self) -> list[Signal]:
        return [signal for signal in self.signals.values() if signal.drill == self.drill]

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Field ``faults`` of a frame, in the order of their onsets."""
        return sorted(self._faults.values(), key=lambda fault: float(fault["onset"]))

    def signal(self, quantity: str) -> Signal | None:
        """Return the signal that shows a quantity; None if there is none with values.

        Beyond the table of quantities, the name of a signal is a quantity.
        """
        if quantity in self.signals:
            return self.signals[quantity]
        shown = QUANTITIES.get(quantity)
        sources = shown.sources if shown else []
        for source in sorted(sources, key=lambda each: each.startswith("Status.")):  # it is slow
            known = [each for each in self.own_signals if each.source == source]
            if found := [each for each in known if self.bins[-1].has(each.name)]:
                return min(found, key=lambda signal: is_foreign(signal.topic))
        return None

    def has(self, quantity: str) -> bool:
        """Return whether there is anything of a quantity."""
        if quantity in IMPACTS and self.impacts.total:
            return True
        return self.is_stepped(quantity) or self.signal(quantity) is not None

    def is_stepped(self, quantity: str) -> bool:
        """Return whether commands determine a quantity; the weight on bit of an arm is measured."""
        if quantity not in self.commands.quantities:
            return False
        shown = self.signal(quantity) if quantity == "weight_on_bit" else None
        return shown is None or not shown.source.startswith("Mount.")

    # What is drawn

    def view(self, start: float, end: float, width: int, kinds: Mapping[str, str]) -> Layer:
        """Return the field ``view`` of a frame: layers of quantities by their kinds."""
        layers = self.impact_layers(start, end, width, kinds)
        for quantity, kind in kinds.items():
            if quantity not in IMPACTS and (signal := self.signal(quantity)):
                layer = self.line(signal, start, end, width // _POINT)
                shown = ("t", "mean") if kind == "line" else ("t", "mean", "low", "high")
                layers[quantity] = {each: layer[each] for each in shown}
        self.mark_faulty(layers, start, end)
        found = {"start": start, "end": end, "detail": "overview"}
        return {**found, "band": "least-greatest", "layers": layers}

    def mark_faulty(self, layers: Mapping[str, Layer], start: float, end: float) -> None:
        """Add to layers where messages are missing, ``holes``, and times of ``garbage`` [s]."""
        for quantity, layer in layers.items():
            signal = self.signal("peak_force" if quantity in IMPACTS else quantity)
            if signal is None:
                continue
            holes = [hole for hole in self.holes(signal) if hole[1] > start and hole[0] < end]
            if holes:
                layer["holes"] = holes[-_MOST_HOLES:]
            wrong = [time for time in self.garbage.get(signal.name, ()) if start <= time <= end]
            if wrong:
                layer["garbage"] = {"t": np.array(wrong[-_MOST_HOLES:]), "count": len(wrong)}

    def holes(self, signal: Signal) -> list[tuple[float, float]]:
        """Return where messages of a signal are missing, from and to [s], by ascending time."""
        if signal.topic == self.struck:
            return self._uncounted()
        used, width = self.bins[-1].used(signal.name), self.bins[-1].width
        return gaps_of(used, width) if self.known == math.inf else []

    def _counter(self) -> Layer:
        """Return times and values of the counter of the impacts, which each status has."""
        own = (each for each in self.own_signals if each.source == "Status.impacts")
        if not (signal := next(own, None)):
            return dict.fromkeys(("t", "mean"), np.empty(0))
        layer = self.bins[-1].view(signal.name, 0.0, self.time or 0.0, _FINEST)
        valid = np.isfinite(layer["mean"])
        return {name: layer[name][valid] for name in ("t", "mean")}

    def _uncounted(self) -> list[tuple[float, float]]:
        """Return where the drill counted twice as many impacts as were received [s]."""
        counter = self._counter()
        times, counted = counter["t"], np.diff(counter["mean"])
        if self.known < math.inf or not len(counted):
            return []
        received = np.diff(np.searchsorted(self.impacts.between(0.0, math.inf)[0], times))
        missing = counted > 2 * received * self.impacts.stride + _LEAST_IMPACTS
        missing &= times[:-1] >= self.since
        return [(float(times[i]), float(times[i + 1])) for i in np.flatnonzero(missing)]

    def line(self, signal: Signal, start: float, end: float, parts: int = _TIMELINE) -> Layer:
        """Return a signal in about so many parts of a range of time [s]."""
        return with_gaps(self.finest(start).view(signal.name, *self._range(start, end, parts)))

    def timeline(self) -> Layer:
        """Return the field ``timeline`` of a frame: peak force, else the first signal."""
        first = (each for each in self.own_signals if self.bins[-1].has(each.name))
        peak = self.signal("peak_force")
        if not (signal := peak or next(first, None)):
            return {}
        of = "peak_force" if peak else signal.name
        return self.line(signal, 0.0, self.time or 0.0) | {"of": of}

    def impact_layers(
        self, start: float, end: float, width: int, wanted: Collection[str]
    ) -> dict[str, Layer]:
        """Return rate and peak forces of the impacts, as far as they are wanted."""
        signal, layers = self.signal("peak_force"), dict[str, Layer]()
        if signal is None:
            return layers
        first, last, parts = self._range(start, end, width // _POINT)
        count = len(self.impacts.between(first, last)[0])
        shown = first, last, min(parts, max(1, count // _LEAST_IMPACTS))
        if "impact_rate" in wanted:
            layers["impact_rate"] = with_gaps(self.impacts.rate(*shown))
        if "peak_force" in wanted and count >= self.most:
            extremes = self.line(signal, start, end, width // _POINT)
            layers["peak_force"] = {**extremes, "band": "least-greatest"}
        elif "peak_force" in wanted:
            spread = self.impacts.spread(*shown)
            outliers = spread.pop("outliers")
            layers["peak_force"] = {**with_gaps(spread), "band": "5-95 %", "outliers": outliers}
        return layers

    def numbers(self, now: float) -> dict[str, Layer | None]:
        """Return the field ``numbers`` of a frame: of the last second before a time [s]."""
        begin = min(max(now - 1.0, self.since), now - 1e-3)
        seconds = min(_SPARK, max(1, int(now - self.since)))
        view, bins = self.finest(begin).view, self.finest(now - seconds)
        found: dict[str, Layer | None] = dict.fromkeys((*IMPACTS, *_NUMBERS))
        if signal := self.signal("peak_force"):
            times, peaks = (each.astype(float) for each in self.impacts.between(begin, now))
            faulty = self._faulty(signal, begin, now)
            peaks = peaks[(np.abs(peaks) <= CREDIBLE) & ("lost" not in faulty)]
            counts = np.histogram(times, _RATES, (begin, now))[0] * self.impacts.stride
            rates = counts * _RATES / (now - begin)
            edges = now - np.arange(seconds, -1, -1.0)
            times, _ = self.impacts.between(edges[0], now)
            spark = np.diff(np.searchsorted(times, edges)) * self.impacts.stride
            rates = self._counted_rate(now) if "lost" in faulty else rates
            found["impact_rate"] = _number(rates, rates, rates, spark)
            means = bins.view(signal.name, edges[0], now, seconds)["mean"]
            found["peak_force"] = _number(peaks, peaks, peaks, means) | faulty
        for number, quantities in _NUMBERS.items():
            if signal := next(filter(None, map(self.signal, quantities)), None):
                means = bins.view(signal.name, now - seconds, now, seconds)["mean"]
                last = view(signal.name, begin, now, _FINEST)
                if not np.isfinite(last["mean"]).any():  # a status is as old as a second
                    last = view(signal.name, begin - 1.0, now, _FINEST)
                shown = _number(last["low"], last["mean"], last["high"], means)
                found[number] = shown | self._faulty(signal, begin, now)
        return found

    def _faulty(self, signal: Signal, begin: float, now: float) -> dict[str, Any]:
        """Return what is wrong with a signal in a range [s]: ``lost``, ``garbage``; or neither."""
        found: dict[str, Any] = {}
        if any(hole[1] > begin and hole[0] < now for hole in self.holes(signal)[-4:]):
            found["lost"] = True
        if count := sum(begin <= time <= now for time in self.garbage.get(signal.name, ())):
            found["garbage"] = count
        return found

    def _counted_rate(self, now: float) -> np.ndarray:
        """Return the rate of the impacts by the two latest statuses at a time [1/s]; or none."""
        counter = self._counter()
        place = int(np.searchsorted(counter["t"], now + self.bins[-1].width, "right"))
        times, counts = (counter[name][max(place - 2, 0) : place] for name in ("t", "mean"))
        return np.asarray(np.diff(counts) / np.diff(times))

    def latest(self, signal: Signal, now: float) -> float | None:
        """Return the latest value of a signal in the second before a time [s]."""
        value = self.finest(now - 1.0).latest(signal.name, now - 1.0, now)
        return value if np.isfinite(value) else None

    def finest(self, start: float) -> Bins:
        """Return the finest bins that hold all from a time on [s]."""
        held = (each for each in self.bins if not each.first or start >= each.first * each.width)
        return next(held, self.bins[-1])

    def _range(self, start: float, end: float, parts: int) -> tuple[float, float, int]:
        """Return a range as far as there are values, and the number of its parts.

        As long as it is not known whole, a part is so long that it holds something of the sample.
        """
        first, last = max(start, self.since), min(end, self.time or 0.0)
        if last > self.known:
            parts = min(parts, int(self.samples * (last - first)))
        else:
            parts = math.ceil(parts * (last - first) / max(end - start, 1e-9))
        return first, max(first, last), max(1, parts)


def _number(low: np.ndarray, mean: np.ndarray, high: np.ndarray, spark: np.ndarray) -> Layer:
    known = np.isfinite(mean)
    found: Layer = dict.fromkeys(("mean", "least", "greatest"))
    if known.any():
        found["mean"] = mean[known].mean()
        found["least"], found["greatest"] = low[known].min(), high[known].max()
    with np.errstate(over="ignore"):
        spark = to_float32(spark)
    return {**found, "spark": spark[np.isfinite(spark)][-_SPARK:]}
