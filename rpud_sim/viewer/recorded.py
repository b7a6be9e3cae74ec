"""Bag that browsers look at: any range of its time, as fine as a screen shows it."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.foundation.quantities import QUANTITIES, ParameterError, ShownQuantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.journal import installed_codec
from rpud_sim.recorded.rebuild import RecordedSegments, recorded_segments
from rpud_sim.simulation.sampling import Times, end_sample, first_sample, sample
from rpud_sim.viewer.bins import Bins, Layer, part_length, thinned
from rpud_sim.viewer.frames import ClientState, Store, StoreError, View
from rpud_sim.viewer.history import (
    IMPACTS,
    IMPACTS_TYPE,
    MOTION,
    SECTION,
    History,
    Signal,
    plain_status,
    seconds,
    with_gaps,
)
from rpud_sim.viewer.recording import STATUS_TYPE, TRAJECTORY_TYPE, Reading, RecordedBag

if TYPE_CHECKING:
    from rpud_sim.viewer.server import PageServer, Place

# Samples of a rebuilt waveform, before those that no screen can show are left out.
SAMPLES = 100_000

HIGHEST_RATE = 1_000_000_000  # greatest rate of a rebuilt waveform [Hz], that of ``rpud export``
SECTION_RATE = 60_000  # of the samples of a section [Hz]

# Channels by the quantities that they show.
CHANNELS = {
    "nodal_plane": "nodal_plane_position",
    "actuator": "actuator_position",
    "free_mass": "free_mass_position",
    "drill_tool": "drill_tool_displacement",
    "contact_force": "contact_force",
    "reacting_force": "reacting_force",
}

MESSAGES, WAVEFORM = "messages", "waveform"  # what a near view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the waveform [s]

_MOST_CHUNKS = 80  # chunks that one view reads
_MOST_BACK = 50  # chunks that are searched for the latest status
_REFRESH = 1.0  # shortest time between pictures of what was read on [s]
_SLICE = 0.07  # longest time for which a question reads on [s]
_MOST_GAPS = 300


class Stretch(NamedTuple):
    """Samples of the waveform without a gap; those of before and after it are missing."""

    times: np.ndarray  # since the bag began, shape (n,), at least one [s]
    channels: Mapping[str, np.ndarray]  # by name, shape (n,)


class Waveforms:
    """Waveforms of one drill in a bag, and the impacts in them."""

    def __init__(self, recording: RecordedBag, drill: str) -> None:
        self._recording, self._drill = recording, drill
        self._topic = recording.topic(drill, TRAJECTORY_TYPE)
        self._impacts = recording.topic(drill, IMPACTS_TYPE)
        self._codec = installed_codec(TRAJECTORY_TYPE)

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._topic)

    def between(self, start: float, end: float, rate: int | None = None) -> list[Stretch]:
        """Return the exact samples between two times since the bag began [s], in their order.

        ``rate`` is whole [Hz]; None for one that gives about ``SAMPLES``.
        """
        if rate is None:
            rate = int(min(max(SAMPLES / max(end - start, 1e-9), 1.0), HIGHEST_RATE))
        found = []
        for zero, segments in self._stretches(start, end):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample(segments, Times.from_grid(first, last - first, rate))
                times = np.arange(first, last, dtype=np.int64) / rate + zero
                found.append(Stretch(times, vars(samples)))
        return sorted(found, key=lambda stretch: float(stretch.times[0]))

    def section(self, end: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the motion until a time [s]; None without any.

        It begins after the last gap.
        """
        found = self.between(end - SECTION, end, SECTION_RATE)
        if not found:
            return None
        times, channels = found[-1]
        arrays = {name: channels[CHANNELS[name]].astype(np.float32) for name in MOTION}
        struck, *rest = self.impacts(float(times[0]), end)
        impacts = np.column_stack([struck - times[0], *rest]).tolist()
        return {"period": 1.0 / SECTION_RATE, "time": times[0], "impacts": impacts, **arrays}

    def impacts(self, start: float, end: float) -> np.ndarray:
        """Return times [s], peak forces [N] and durations [s] of impacts in a range: (3, n)."""
        numbers = self._recording.chunks_between(self._drill, start, end)
        columns = ("peak_force", "contact_duration")
        found = self._recording.series(self._impacts, columns, numbers)
        return found[:, (found[0] >= start) & (found[0] <= end)]

    def next_impact(self, time: float, *, back: bool = False) -> dict[str, float] | None:
        """Return the first impact after a time since the bag began [s], or the last before it."""
        recording = self._recording
        for number in recording.chunks_from(self._drill, time, back=back):
            if self._impacts in recording.chunks[number].topics:
                found = self.impacts(*(recording.span(self._drill, number) or (0.0, -1.0)))
                found = found[:, found[0] < time if back else found[0] > time]
                if found.size:
                    names = ("time", "peak_force", "contact_duration")
                    return dict(zip(names, found[:, -1 if back else 0].tolist(), strict=True))
        return None

    def _stretches(self, start: float, end: float) -> Iterator[tuple[float, np.ndarray]]:
        """Yield gapless stretches of the trajectory, and when in the bag their time zero was [s].

        They cover a range, and begin before it and end after it.
        """
        recording = self._recording
        held: list[np.ndarray] = []
        zero = 0.0
        for each in self._segments(start, end) if self._topic else ():
            begin = (each.origin - recording.offset(self._topic, each.published)) / SECOND
            if held and not (each.follows and begin == zero):
                yield zero, np.concatenate(held)
                held = []
            held.append(each.segments)
            zero = begin
        if held:
            yield zero, np.concatenate(held)

    def _segments(self, start: float, end: float) -> Iterator[RecordedSegments]:
        recording = self._recording
        numbers = enumerate(recording.chunks_between(self._drill, start, end))
        # Chunks that follow each other.
        for _, adjacent in itertools.groupby(numbers, lambda each: each[1] - each[0]):
            parts = (recording.messages(number, self._topic) for _, number in adjacent)
            messages = sorted(itertools.chain(*parts), key=lambda message: message.log_time)
            try:
                yield from recorded_segments(messages, self._codec, recording.path)
            except BagError:
                continue  # what came before the damage is drawn


class RecordedDrill(History):
    """Drill in a bag; what lies near is drawn from its messages, and from its exact waveform."""

    def __init__(self, drill: str, recording: RecordedBag, reading: Callable[[], Reading]) -> None:
        super().__init__(drill, recording.signals, ())
        self.recording = recording
        self.is_drill = recording.is_drill(drill)
        self.waveforms = Waveforms(recording, drill)
        self._reading = reading
        self.pictures = 0  # of what was read, at most one each ``_REFRESH``

    @property
    def version(self) -> int:
        return self.pictures

    def range(self, view: View) -> tuple[float, float]:
        """Return the range that a browser shows; the whole bag before it asks for one."""
        now = self.time or 0.0
        if view.follow is not None:
            return 0.0, now
        start = min(max(view.start, 0.0), now)
        return start, max(min(view.end, now), start + 1e-9)

    def has(self, quantity: str) -> bool:
        """Return whether there is anything of a quantity."""
        return (quantity in CHANNELS and bool(self.waveforms)) or super().has(quantity)

    def others(self) -> list[ShownQuantity]:
        """Return the signals beyond the table of quantities, those of the drill first."""
        known = {self.signal(quantity) for quantity in QUANTITIES}
        left = [
            signal
            for signal in self.signals.values()
            if signal not in known and self.bins[-1].has(signal.name)
        ]
        return [
            ShownQuantity(
                signal.name,
                f"{signal.topic.removeprefix(f'{self.drill}/')} {signal.column}",
                signal.unit,
                zero=False,
            )
            for signal in sorted(left, key=lambda signal: signal.drill != self.drill)
        ]

    def view_key(self, start: float, end: float) -> Any:
        """Return what changes when a view does: a long one is made of what was read so far."""
        grows = end - start > MESSAGES_RANGE or end > (self.time or 0.0) - _REFRESH
        return start, end, self.version if grows else None

    def view(self, start: float, end: float, width: int, kinds: Mapping[str, str]) -> Layer:
        """Return the field ``view`` of a frame with layers of quantities by their kinds."""
        signals = {name: self.signal(name) for name in kinds if name not in IMPACTS}
        wanted = {name: signal for name, signal in signals.items() if signal is not None}
        numbers = self._chunks({self.drill, *(each.drill for each in wanted.values())}, start, end)
        if numbers is None:
            return super().view(start, end, width, kinds)
        self._reading().look(numbers)
        layers = self.impact_layers(start, end, width, kinds)
        times, peaks = self.impacts.between(start, end)
        if "peak_force" in layers and len(times) <= width // 2:
            layers["peak_force"] = {"t": times, "mean": peaks}
        for name, signal in wanted.items():
            times, values = self._series(signal, numbers, start, end)
            layer = {"t": times, "mean": values}
            if len(times) > width:
                bins = Bins([name], part_length(start, end, width // 2), 2 * width, newest=True)
                bins.add(name, times, values)
                layer = bins.view(name, start, end, width)
            layers[name] = with_gaps(layer)
        exact = end - start < 1.001 * WAVEFORM_RANGE
        near = self.waveforms.between(start, end) if exact else []
        if near:
            struck = "peak_force" in layers and len(layers["peak_force"]["t"]) > 0
            for quantity, channel in CHANNELS.items():
                silent = not any(stretch.channels[channel].any() for stretch in near)
                # Before drilling an impact has no duration.
                if not (channel == "contact_force" and silent and struck):
                    layers[quantity] = _waveform_layer(near, channel, width)
        found = {"start": start, "end": end, "detail": WAVEFORM if near else MESSAGES}
        return {**found, "band": "least-greatest", "layers": layers}

    def moment(self, time: float) -> dict[str, Any]:
        """Return status, values, numbers and hole of a frame at a time [s]."""
        self._reading().look(self.recording.chunks_between(self.drill, time - 1.0, time))
        values = dict[str, dict[str, float]]()
        for signal in self.own_signals:
            if (value := self.latest(signal, time)) is not None:
                values.setdefault(signal.topic.rpartition("/")[2], {})[signal.column] = value
        found = {"status": self._status(time), "values": values, "numbers": self.numbers(time)}
        hole = self.hole(time)
        return found | ({"hole": hole} if hole else {})

    def section_key(self, time: float) -> Any:
        return time

    def section(self, time: float) -> dict[str, Any] | None:
        return self.waveforms.section(time)

    def _series(
        self, signal: Signal, numbers: Sequence[int], start: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of a signal in a range, with the one before and the one after."""
        times, values = self.recording.series(signal.topic, (signal.column,), numbers)
        valid = np.isfinite(values)
        times, values = times[valid], values[valid]
        first, last = np.searchsorted(times, [start, np.nextafter(end, np.inf)])
        chosen = slice(max(first - 1, 0), last + 1)
        return times[chosen], values[chosen]

    def _status(self, time: float) -> dict[str, Any]:
        """Return the fields of the last status at a time [s] or before; none before the first."""
        recording, drill = self.recording, self.drill
        topic = recording.topic(drill, STATUS_TYPE)
        if not topic or not recording.readers[topic].stamped:
            return {}
        for number in itertools.islice(recording.chunks_from(drill, time, back=True), _MOST_BACK):
            for message in reversed(recording.messages(number, topic)):
                origin = recording.offset(topic, message.publish_time)
                with suppress(BagError):  # another program wrote it
                    status = recording.readers[topic].codec.decode(message.data)
                    if seconds(status.header.stamp, origin) <= time + 1e-9:
                        return plain_status(vars(status), origin)
        return {}

    def _chunks(self, drills: Collection[str], start: float, end: float) -> list[int] | None:
        """Return the chunks of a range; None for more than one view reads."""
        if end - start > MESSAGES_RANGE:
            return None
        found: set[int] = set()
        for drill in drills:
            numbers = self.recording.chunks_between(drill, start, end)
            found.update(itertools.islice(numbers, _MOST_CHUNKS + 1))
        return sorted(found) if len(found) <= _MOST_CHUNKS else None


class RecordedStore(Store):
    """Store of one bag.

    When it is made it has read a sample of the bag, so that a page can stand at once. Each question
    for a frame reads on for a moment.
    """

    mode = "recorded"

    def __init__(self, path: str | Path) -> None:
        self.recording = RecordedBag(path)
        try:
            self.histories = {
                drill: RecordedDrill(drill, self.recording, lambda: self.reading)
                for drill in self.recording.time_lines
            }
            self.reading = Reading(self.recording, self.histories)
        except BaseException:
            self.recording.close()
            raise
        self._refreshed = 0.0  # time of the latest picture
        self._more = True  # whether there was more to read
        self._states: dict[str, tuple[int, dict[str, Any]]] = {}  # by drill, of a picture

    def read_all(self) -> None:
        """Read the whole bag."""
        while self.reading.read_next():
            pass
        self._more = False
        self._draw()

    def __enter__(self) -> RecordedStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.recording.close()

    @property
    def drills(self) -> list[str]:
        """Namespaces of drills; of a bag without a drill, those with signals."""
        found = sorted(self.histories)
        ours = [drill for drill in found if self.histories[drill].is_drill]
        return ours or sorted({signal.drill for signal in self.recording.signals}) or found

    def open(self, client: ClientState) -> None:
        """Note one more browser; an unknown drill is an error, none is the first."""
        client.drill = client.drill or self.drills[0]
        if client.drill not in self.drills:
            raise StoreError(f"the bag holds no drill {client.drill:.100}")

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Find an impact: the next frame has it as ``jump``."""
        if name != "seek":
            raise ParameterError("a recorded drill takes no commands")
        back = content["to"] == "previous"
        since = float(content["from"]) + (-1e-9 if back else 1e-9)
        found = self.histories[client.drill].waveforms.next_impact(since, back=back)
        word = "earlier" if back else "further"
        client.jump = found or {"none": f"there is no {word} impact"}

    @contextmanager
    def shown(self, client: ClientState) -> Iterator[tuple[RecordedDrill, Mapping[str, Any]]]:
        history = self.histories[client.drill]
        picture, state = self._states.get(client.drill, (-1, {}))
        if picture != history.pictures:
            state = self._state(history)
            self._states[client.drill] = history.pictures, state
        yield history, state
        self._read_on()

    def _state(self, history: RecordedDrill) -> dict[str, Any]:
        recording, bag, now = self.recording, self.recording.bag, history.time or 0.0
        losses = {}
        timing = {
            "bag": f"{recording.path.name}: {bag.duration / SECOND:.6g} s, "
            f"{bag.message_count} messages, {bag.size / 1e6:.1f} MB"
        }
        for summary in bag.readable_topics:
            name, rate = summary.topic.name, summary.rate
            at = f" at {rate:.4g} Hz" if rate else ""
            timing[name] = f"{summary.message_count} messages{at}"
            if summary.losses is not None and summary.losses.total:
                losses[name] = summary.losses.total
        return {
            "run": 1,
            "drills": self.drills,
            "drill": history.drill,
            "now": now,
            "extent": [0.0, now],
            "read": self.reading.share,
            "notice": self._notice(history),
            "timing": timing,
            "losses": losses,
            "gaps": [list(gap) for gap in self.reading.gaps()[:_MOST_GAPS]],
        }

    def _notice(self, history: RecordedDrill) -> str:
        """Return what a user must know of the state of the bag; empty for nothing."""
        recording, drill, parts = self.recording, history.drill, []
        if unknown := recording.unknown.get(drill):
            parts.append(f"Its runs are not known: {unknown:.300}.")
        if recording.damages:
            first = next(iter(recording.damages.values()))
            parts.append(f"{len(recording.damages)} damaged parts are skipped: {first:.300}")
        counts = {name: reader.unreadable for name, reader in recording.readers.items()}
        unreadable = [f"{count} of {name:.100}" for name, count in counts.items() if count]
        if unreadable:
            parts.append(f"Messages that cannot be read: {', '.join(unreadable[:5])}.")
        if unlisted := self.reading.unlisted + history.unlisted:
            parts.append(f"{unlisted} faults or messages of faults are not shown.")
        if history.is_drill and not history.waveforms:
            parts.append("The bag holds no trajectory, from which its motion could be drawn.")
        if not recording.signals:
            parts.append("The bag holds no numbers that can be drawn over time.")
        elif recording.left_out:
            names = ", ".join([*recording.left_out][:5])
            parts.append(f"Topics that cannot be drawn: {names:.300}.")
        return " ".join(parts)

    def _read_on(self) -> None:
        begun = time.monotonic()
        more = self.reading.read_next()
        while more and time.monotonic() - begun < _SLICE:
            more = self.reading.read_next()
        if self._more and (not more or begun - self._refreshed > _REFRESH):
            self._refreshed = begun
            self._draw()
        self._more = more

    def _draw(self) -> None:
        for history in self.histories.values():
            history.pictures += 1


def serve_bag(
    bag: str | os.PathLike[str], place: Place, announce: Callable[[PageServer], object]
) -> None:
    """Serve the screen of a bag until SIGINT or SIGTERM.

    ``announce`` is called once the server listens, and prints ``server.url("/screen")``.
    """
    from rpud_sim.viewer.server import PageServer  # needs Tornado, which a report does without

    with RecordedStore(os.fspath(bag)) as store, PageServer(store, place) as server:
        announce(server)
        server.run()


def _waveform_layer(stretches: Sequence[Stretch], channel: str, most: int) -> Layer:
    """Return a channel with every peak, and NaN where samples are missing."""
    parts = []
    for times, channels in stretches:
        part = thinned(times, channels[channel], most)
        parts += [part, {"t": part["t"][-1:], "mean": np.full(1, np.nan)}]
    return {name: np.concatenate([part[name] for part in parts[:-1]]) for name in ("t", "mean")}
