"""Bag that browsers look at: any range of its time, as fine as a screen shows it."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.shown_quantities import QUANTITIES, ShownQuantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.runs import choose_namespace
from rpud_sim.viewer.bins import CREDIBLE, Bins, Layer, part_length, thinned, with_gaps
from rpud_sim.viewer.borehole import hole_of
from rpud_sim.viewer.frames import ClientState, Store, View
from rpud_sim.viewer.history import (
    IMPACTS,
    SECTION,
    History,
    Signal,
    plain_status,
    seconds,
)
from rpud_sim.viewer.recording import STATUS_TYPE, Reading, RecordedBag
from rpud_sim.viewer.waveforms import CHANNELS, Waveform, Waveforms

if TYPE_CHECKING:
    from rpud_sim.viewer.server import ListenAddress, PageServer

MESSAGES, WAVEFORM = "messages", "waveform"  # what a near view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the waveform [s]

_MOST_CHUNKS = 80  # chunks that one view reads
_MOST_BACK = 50  # chunks that are searched for the latest status
_REFRESH = 1.0  # shortest time between pictures of what was read on [s]
_SLICE = 0.07  # longest time for which a question reads on [s]
_MOST_GAPS = 300


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
        """Return the signals beyond the table of quantities, the drill's first."""
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
        clocks = {self.recording.clock(each.topic) for each in wanted.values()}
        numbers = self._chunks({self.drill, *clocks}, start, end)
        if numbers is None:
            return super().view(start, end, width, kinds)
        self._reading().look(numbers)
        layers = self.impact_layers(start, end, width, kinds)
        times, peaks = self.impacts.between(start, end)
        if "peak_force" in layers and len(times) <= width // 2:
            credible = np.abs(peaks) <= CREDIBLE
            layers["peak_force"] = {"t": times[credible], "mean": peaks[credible]}
        for name, signal in wanted.items():
            times, values = self._series(signal, numbers, start, end)
            layer = {"t": times, "mean": values}
            if len(times) > width:
                bins = Bins([name], part_length(start, end, width // 2), 2 * width, newest=True)
                bins.add(name, times, values)
                layer = bins.view(name, start, end, width)
            layers[name] = with_gaps(layer)
        self.mark_faulty(layers, start, end)
        exact = end - start < 1.001 * WAVEFORM_RANGE
        near = self.waveforms.between(start, end) if exact else []
        if near:
            struck = "peak_force" in layers and len(layers["peak_force"]["t"]) > 0
            for quantity, channel in CHANNELS.items():
                silent = not any(waveform.channels[channel].any() for waveform in near)
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
        hole = hole_of(self, time)
        return found | ({"hole": hole} if hole else {})

    def section_key(self, time: float) -> Any:
        return time

    def section(self, time: float) -> dict[str, Any] | None:
        return self.waveforms.section(max(time, SECTION))  # at the start, the first motion

    def _series(
        self, signal: Signal, numbers: Sequence[int], start: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of a signal in a range, with the one before and the one after."""
        times, values = self.recording.series(signal.topic, (signal.column,), numbers)
        valid = self.is_credible(signal, values)
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
            for batch in reversed([*recording.batches([number], {topic})]):
                for place in reversed(range(len(batch))):
                    with suppress(BagError):  # another program wrote it
                        status = recording.readers[topic].codec.decode(batch.message(place))
                        if seconds(status.header.stamp, batch.origin) <= time + 1e-9:
                            return plain_status(vars(status), batch.origin)
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

    At first it reads a sample of the bag, so that a page opens quickly. Each request for a frame
    reads on for a moment.
    """

    mode = "recorded"

    def __init__(self, path: str | Path) -> None:
        self.recording = RecordedBag(path)
        try:
            self.histories = {
                drill: RecordedDrill(drill, self.recording, lambda: self.reading)
                for drill in self.recording.clocks
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
        drills = self.drills
        client.drill = choose_namespace(self.recording.path, drills, client.drill or drills[0])

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
            "moves": bool(history.waveforms),
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
        outside = [
            f"{count} of {name:.100}" for name, count in self.reading.outside.items() if count
        ]
        if outside:
            parts.append(f"Stamps outside the run, not drawn: {', '.join(outside[:5])}.")
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
    bag: str | os.PathLike[str], place: ListenAddress, announce: Callable[[PageServer], object]
) -> None:
    """Serve the screen of a bag until SIGINT or SIGTERM.

    ``announce`` is called once the server listens, and prints ``server.url("/screen")``.
    """
    from rpud_sim.viewer.server import PageServer  # needs Tornado, which a report does without

    with RecordedStore(os.fspath(bag)) as store, PageServer(store, place) as server:
        announce(server)
        server.run()


def _waveform_layer(waveforms: Sequence[Waveform], channel: str, most: int) -> Layer:
    """Return a channel with every peak, and NaN where samples are missing."""
    parts = []
    for times, channels in waveforms:
        part = thinned(times, channels[channel], most)
        parts += [part, {"t": part["t"][-1:], "mean": np.full(1, np.nan)}]
    return {name: np.concatenate([part[name] for part in parts[:-1]]) for name in ("t", "mean")}
