"""Store of the running drills of a ROS domain, and the frames that show them."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rpud_sim.foundation.quantities import QUANTITIES, ParameterError, number_text, shown
from rpud_sim.ros.client.listening_node import DrillFinder
from rpud_sim.ros.process import StartError
from rpud_sim.viewer.frames import ClientState, Store, StoreError
from rpud_sim.viewer.live_drill import LiveDrill, LiveHistory
from rpud_sim.viewer.server import PageServer, Place

MOST_DRILLS = 16  # that are heard; for a further one, one that has gone is forgotten

_GAP = 1.0  # shortest time before the server heard the drill that is shown as a gap [s]
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

    @contextmanager
    def shown(self, client: ClientState) -> Iterator[tuple[LiveHistory, Mapping[str, Any]]]:
        if time.monotonic() - self._looked >= _LOOK_PERIOD:
            self._look()
        drill = self._heard(client)
        if drill.error:
            raise StoreError(f"the thread that hears {drill.namespace} has ended: {drill.error}")
        with drill.reading() as history:
            yield history, self._state(drill, history)

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

    def _state(self, drill: LiveDrill, history: LiveHistory) -> dict[str, Any]:
        status, since = history.status, history.since
        state = {
            "run": history.run,
            "drills": sorted({*self._namespaces, drill.namespace}),
            "drill": drill.namespace,
            "connection": drill.connection,
            "kinds": drill.kinds,
            "channels": drill.channels,
            "losses": drill.lost,
            "outcomes": drill.actions.outcomes,
            "status": status,
            "timing": {
                label: QUANTITIES["lateness"].text(status[name])
                if name in ("lateness_max", "lag")
                else number_text(float(status[name]))
                for label, name in _TIMING.items()
                if name in status
            },
        }
        if history.time is not None:
            state |= {"now": history.time, "extent": [0.0, history.time]}
            state["gaps"] = [[0.0, since]] if since > _GAP else []
        return state


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
