"""Store of the running drills of a ROS domain, and the frames that show them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import QUANTITIES, ParameterError, number_text, shown
from rpud_sim.ros.client.listening_node import DrillFinder
from rpud_sim.ros.process import StartError
from rpud_sim.viewer.heard import Block, Heard
from rpud_sim.viewer.live_drill import LiveDrill
from rpud_sim.viewer.picture import MOTION, SECTION, chosen_quantities, drill_plots
from rpud_sim.viewer.server import PageServer, Place
from rpud_sim.viewer.session import ClientState, Store, StoreError

MOST_DRILLS = 16  # that are heard; for a further one, one that has gone is forgotten

_GAP = 1.0  # shortest time before the server heard the drill that is shown as a gap [s]
_MOST_SAMPLES = 1200  # of a section
_SHARE = 100.0  # a view may take one part of so many of the time
_LOOK_PERIOD = 3.0  # between looks at the namespaces [s]


# Rows of "timing", and what a status has for them.
_TIMING = {
    "latest block of the last report": "lateness_max",
    "behind its schedule": "lag",
    "real-time factor": "real_time_factor",
    "deadlines missed": "deadlines_missed",
    "messages dropped by the drill": "messages_dropped",
    "commands accepted": "commands_accepted",
    "commands overwritten": "commands_discarded",
    "commands refused": "commands_rejected",
    "commanders": "commanders",
}


class LiveStore(Store):
    """Drills of a domain; one thread hears each, however many pages show it.

    A drill is heard from its first page on, so that later ones show its past. A page that names no
    drill shows that of ``namespace``, which may start later.
    """

    mode = "live"

    def __init__(self, finder: DrillFinder, namespace: str = "/rpud") -> None:
        self.heard: dict[str, LiveDrill] = {}  # drills by namespace
        self.finder = finder
        self._default = f"/{namespace.strip('/')}"
        self._namespaces: list[str] = []
        self._looked = -math.inf

    def open(self, client: ClientState) -> None:
        """Hear the drill that a browser shows; StoreError if it is unknown, or one too many."""
        client.drill = f"/{(client.drill or self._default).strip('/')}"
        self.hear(client.drill)

    def hear(self, name: str = "") -> None:
        """Hear a drill from now on; by default that of pages that name none."""
        name = name or self._default
        if name in self.heard and not self.heard[name].error:
            return
        if name not in (self._default, *self._look()):
            raise StoreError(f"there is no drill in {name}")
        gone = [each for each, drill in self.heard.items() if drill.gone]
        if len(self.heard) >= MOST_DRILLS and gone:
            self.heard.pop(gone[0]).close()
        if len(self.heard) >= MOST_DRILLS:
            raise StoreError(f"{MOST_DRILLS} drills are shown already: start another server")
        try:
            self.heard[name] = LiveDrill(name, self.finder.domain_id)  # its thread may do better
        except StartError as error:
            raise StoreError(str(error)) from None

    def end(self) -> None:
        """Hear no more of any drill."""
        for drill in self.heard.values():
            drill.close()
        self.heard.clear()

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return what has changed."""
        if time.monotonic() - self._looked >= _LOOK_PERIOD:
            self._look()
        drill = self._heard(client)
        if drill.error:
            raise StoreError(f"the thread that hears {drill.namespace} has ended: {drill.error}")
        with drill.reading() as heard:
            if client.sent.get("run", (None,))[0] != heard.run:
                client.sent.clear()
                client.section = True
            return self._state(drill, heard, client) | measured(heard, client) or None

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Queue an action."""
        if name != "act":
            raise ParameterError(f"a running drill has no {shown(name)}")
        self._heard(client).act(content["name"], content["arguments"])

    def _heard(self, client: ClientState) -> LiveDrill:
        if client.drill not in self.heard:
            raise StoreError(f"{client.drill} has gone")
        return self.heard[client.drill]

    def _look(self) -> list[str]:
        self._looked = time.monotonic()
        self._namespaces = self.finder.drills()
        return self._namespaces

    def _state(self, drill: LiveDrill, heard: Heard, client: ClientState) -> dict[str, Any]:
        """Return what has changed of a drill's state."""
        plain = {
            "run": heard.run,
            "growing": True,
            "drills": sorted({*self._namespaces, drill.namespace}),
            "drill": drill.namespace,
            "connection": drill.connection,
            "kinds": drill.kinds,
            "channels": drill.channels,
            "losses": drill.lost,
            "outcomes": drill.actions.outcomes,
            "status": heard.status,
            "faults": heard.faults,
        }
        if heard.time is not None:
            plain |= {"now": heard.time, "extent": [0.0, heard.time]}
        if heard.since is not None:
            plain["gaps"] = [[0.0, heard.since]] if heard.since > _GAP else []
        frame = {name: value for name, value in plain.items() if client.is_due(name, value)}
        if "status" in frame:
            frame["timing"] = {
                label: QUANTITIES["lateness"].text(heard.status[name])
                if name in ("lateness_max", "lag")
                else number_text(float(heard.status[name]))
                for label, name in _TIMING.items()
                if name in heard.status
            }
        return frame


def measured(heard: Heard, client: ClientState) -> dict[str, Any]:
    """Return what is new for a browser: commands, plots, numbers and motion."""
    sent, due, view, found = client.sent, client.is_due, client.view, dict[str, Any]()
    now = heard.time or 0.0
    start, end = (view.start, view.end) if view.follow is None else (now - view.follow, now)
    if due("values", heard.version, 0.5):
        found["values"] = heard.values
    if due("log", heard.log_version, 0.5):
        found |= heard.commands.frame(heard.faults)
    stepped = [name for name in heard.commands.quantities if heard.is_stepped(name)]
    if due("steps", (heard.log_version, view, stepped), 0.5):
        # An entry of the journal may come before the messages of its time.
        last = math.inf if view.follow else end
        steps = heard.commands.steps(start, last, view.width)
        found["steps"] = {name: steps[name] for name in stepped}
    if heard.time is None:
        return found
    # By what was heard, not by its time: a message that arrives late is shown too.
    if due("has", heard.version, 1.0):
        plots = drill_plots(heard.has)
        if due("plots", plots):
            found["plots"] = plots
    if due("numbers", heard.version, 0.2):
        found["numbers"] = heard.picture().numbers(now)
    if due("whole", heard.version, 1.0):
        whole = heard.picture(0.0)
        found["timeline"] = whole.line("peak_force", 0.0, now)
        found["hole"] = whole.hole(now, heard.commands.parameters)
    block = heard.block
    if client.section and block is not None and due("section", (block[0], heard.impacts.total)):
        found["section"] = _section(heard, block)
    if due("asked", (view, client.choices, sent["plots"][0])):
        sent["view"] = None, -math.inf
    if due("view", heard.version, sent.get("cost", 0.0) * _SHARE):
        began = time.thread_time()
        chosen = chosen_quantities(sent["plots"][0], client.choices)
        kinds = {name: kind for name, kind in chosen.items() if not heard.is_stepped(name)}
        found["view"] = heard.picture(start).view(start, end, view.width, kinds)
        sent["cost"] = time.thread_time() - began
    return found


def _section(heard: Heard, block: Block) -> dict[str, Any]:
    """Return the end of a block."""
    begin, period, arrays = block
    length = len(arrays[0])
    first = max(0, length - max(2, round(SECTION / period)))
    stride = -(-(length - first) // _MOST_SAMPLES)
    time, end = begin + first * period, begin + length * period
    samples = {
        name: array[first::stride].astype(np.float32)
        for name, array in zip(MOTION, arrays, strict=False)
    }
    impacts = [[at - time, *rest] for at, *rest in heard.latest_impacts if time <= at < end]
    own = {"time": time, "period": period * stride, "impacts": impacts}
    return {**samples, **own}


def serve_drills(
    place: Place,
    domain_id: int | None,
    namespace: str,
    announce: Callable[[PageServer, LiveStore], object],
) -> None:
    """Serve a screen for each drill until SIGINT or SIGTERM.

    ``announce`` is called once the server listens. A page without a namespace shows the drill of
    ``namespace``.
    """
    with DrillFinder(domain_id) as finder:
        store = LiveStore(finder, namespace)
        try:
            with PageServer(store, place) as server:
                announce(server, store)
                server.run()
        finally:
            store.end()
