"""Bag that browsers look at: opened once, read on while they look."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.foundation.quantities import QUANTITIES, ParameterError, ShownQuantity, for_browser
from rpud_sim.foundation.time import SECOND
from rpud_sim.viewer.picture import choice_of, chosen_quantities, drill_plots
from rpud_sim.viewer.recording import RecordedSignal
from rpud_sim.viewer.session import ClientState, Store, StoreError
from rpud_sim.viewer.views import MESSAGES_RANGE, Views

if TYPE_CHECKING:
    from rpud_sim.viewer.server import PageServer, Place

_REFRESH = 1.0  # shortest time between pictures of what was read on [s]
_SLICE = 0.07  # longest time for which a question reads on [s]
_MOST_PLOTS = 5  # of a bag without a drill
_MOST_GAPS = 300


class RecordedStore(Store):
    """Store of one bag.

    When it is made it has read a sample of the bag, so that a page can stand at once. Each question
    for a frame reads on for a moment.
    """

    mode = "recorded"

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._bag = Views(self.path)
        self._version = 0  # of what was read; grows at most each ``_REFRESH``
        self._reading = True  # whether there was more to read
        self._refreshed = 0.0  # time of the latest picture

    def read_all(self) -> Views:
        """Read the whole bag at once, and return it."""
        while self._bag.overview.read_next():
            pass
        self._version += 1
        return self._bag

    def __enter__(self) -> RecordedStore:
        return self

    def __exit__(self, *_: object) -> None:
        self._bag.recording.close()

    # For pages

    @property
    def drills(self) -> list[str]:
        """Namespaces of drills; of a bag without a drill, those with signals."""
        recording = self._bag.recording
        found = sorted(recording.clocks)
        ours = [drill for drill in found if recording.is_drill(drill)]
        return ours or sorted({signal.drill for signal in recording.signals}) or found

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
        found = self._bag.waveforms.next_impact(client.drill, since, back=back)
        word = "earlier" if back else "further"
        client.sent["jump"] = found or {"none": f"there is no {word} impact"}

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return what is new for a browser; None for nothing."""
        frame = self._frame(client)
        self._read_on()
        return frame or None

    # Inside

    def _frame(self, client: ClientState) -> dict[str, Any]:
        bag, drill, version, width = self._bag, client.drill, self._version, client.view.width
        sent, due, overview = client.sent, client.is_due, bag.overview
        if due("described", version):
            sent["described plots"] = self._describe(drill)
        plots, others = sent["described plots"]
        now, commands = overview.end, overview.commands[drill]
        playhead = now if client.playhead is None else min(max(client.playhead, 0.0), now)
        kinds = chosen_quantities(plots, client.choices)
        start, end = self._range(client, now)
        frame: dict[str, Any] = {}
        if due("drills", drill):
            frame |= {"drills": self.drills, "drill": drill, "run": 1}
        if due("plots", plots):
            frame |= {"plots": plots, "quantities": for_browser() + others}
        if due("state", version):
            frame |= {**self._state(now), "timeline": bag.timeline(drill)}
        if due("marks", overview.version):
            faults = overview.faults(drill)
            frame |= {"faults": faults, **commands.frame(faults)}
        # A long view is made of what was read so far, and a late one may grow.
        moving = end - start > MESSAGES_RANGE or end > now - _REFRESH
        basis = version if moving else bag.recording.clocks[drill]
        if due("view", (start, end, width, kinds, basis)):
            frame["view"] = bag.view(drill, start, end, width, kinds)
        if due("steps", (start, end, width, overview.version)):
            frame["steps"] = commands.steps(start, end, width)
        if due("moment", (playhead, version)):
            frame |= bag.moment(drill, playhead)
        if client.section and due("section", playhead):
            section = bag.waveforms.section(drill, playhead)
            frame |= {"section": section} if section else {}
        if "jump" in sent:
            frame["jump"] = sent.pop("jump")
        return frame

    def _describe(self, drill: str) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
        """Return the plots of a drill, and the quantities of the signals beyond the table."""
        bag = self._bag
        known = {bag.signal(drill, quantity) for quantity in QUANTITIES}
        left = [
            each for each in bag.recording.signals if each not in known and bag.has_values(each)
        ]
        left.sort(key=lambda signal: signal.drill != drill)
        quantities = [_quantity(signal, drill) for signal in left]
        others = [each.for_browser() for each in quantities]
        choices = [choice_of(each.name, each.label, {each.name: each.label}) for each in quantities]
        if bag.recording.is_drill(drill):
            steps = bag.overview.commands[drill].quantities
            plots = drill_plots(lambda name: name in steps or bag.has(drill, name), choices)
            return plots, others
        plots = [
            {"id": f"signal{n}", "title": "signal", "choices": choices[n:] + choices[:n]}
            for n in range(min(_MOST_PLOTS, len(choices)))
        ]
        return plots, others

    def _range(self, client: ClientState, now: float) -> tuple[float, float]:
        """Return the range that a browser shows; the whole bag before it asks for one."""
        view = client.view
        if view.follow is not None:
            return 0.0, now
        start = min(max(view.start, 0.0), now)
        return start, max(min(view.end, now), start + 1e-9)

    def _state(self, now: float) -> dict[str, Any]:
        recording, overview, bag = self._bag.recording, self._bag.overview, self._bag.recording.bag
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
            "now": now,
            "extent": [0.0, now],
            "read": overview.share,
            "notice": self._notice(),
            "timing": timing,
            "losses": losses,
            "gaps": [list(gap) for gap in overview.gaps()[:_MOST_GAPS]],
        }

    def _notice(self) -> str:
        """Return what a user must know of the state of the bag; empty for nothing."""
        recording, unlisted, parts = self._bag.recording, self._bag.overview.unlisted, []
        if recording.damages:
            first = next(iter(recording.damages.values()))
            parts.append(f"{len(recording.damages)} damaged parts are skipped: {first:.300}")
        counts = {name: reader.unreadable for name, reader in recording.readers.items()}
        unreadable = [f"{count} of {name:.100}" for name, count in counts.items() if count]
        if unreadable:
            parts.append(f"Messages that cannot be read: {', '.join(unreadable[:5])}.")
        if unlisted:
            parts.append(f"{unlisted} entries of journal and faults are not shown.")
        if not self._bag.waveforms.has(self.drills[0]) and recording.is_drill(self.drills[0]):
            parts.append("The bag holds no trajectory, from which its motion could be drawn.")
        if not recording.signals:
            parts.append("The bag holds no numbers that can be drawn over time.")
        elif recording.left_out:
            names = ", ".join([*recording.left_out][:5])
            parts.append(f"Topics that cannot be drawn: {names:.300}.")
        return " ".join(parts)

    def _read_on(self) -> None:
        now = time.monotonic()
        read_next = self._bag.overview.read_next
        more = read_next()
        self._reading |= more
        while more and time.monotonic() - now < _SLICE:
            more = read_next()
        if self._reading and (not more or now - self._refreshed > _REFRESH):
            self._refreshed = now
            self._version += 1
        self._reading = more


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


def _quantity(signal: RecordedSignal, drill: str) -> ShownQuantity:
    """Return a signal as a quantity of the table that the browser has."""
    label = f"{signal.topic.removeprefix(f'{drill}/')} {signal.column}"
    return ShownQuantity(signal.name, label, signal.unit, zero=False)
