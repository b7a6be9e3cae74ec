"""Store of the running drills of a ROS domain."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any
from urllib.parse import urlencode

from rpud_sim.foundation.quantities import ParameterError, shown
from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.ros.starting import StartError
from rpud_sim.viewer.live.live_drill import LiveDrill
from rpud_sim.viewer.live.live_frame import LiveFrame
from rpud_sim.viewer.server import PageServer, Place
from rpud_sim.viewer.store import ClientState, StoreError

# How long a drill is heard after its last page has gone: a page may be loaded again [s].
LINGER = 120.0
MOST_DRILLS = 16

_LOOK_PERIOD = 3.0  # between looks at the namespaces [s]


def drill_path(namespace: str) -> str:
    """Return the address of a drill's screen on the server."""
    return f"/screen?{urlencode({'namespace': namespace}, safe='/')}"


class LiveStore:
    """Drills of a domain; one thread hears each, however many pages show it.

    A page that names no drill shows that of ``namespace``, which may start later. ``clock`` gives
    the present time [s].
    """

    mode = "live"

    def __init__(
        self,
        finder: DrillFinder,
        namespace: str = "/rpud",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.heard: dict[str, LiveDrill] = {}  # drills by namespace
        self._finder = finder
        self._default = f"/{namespace.strip('/')}"
        self._clock = clock
        self._pages: dict[int, LiveDrill] = {}  # by browser
        self._left_at: dict[str, float] = {}
        self._kept = ""  # drill that is heard without any page
        self._namespaces: list[str] = []
        self._looked = -math.inf

    def open(self, client: ClientState) -> None:
        """Hear the drill that a browser shows; StoreError if it is unknown, or one too many."""
        name = f"/{(client.drill or self._default).strip('/')}"
        if name in self.heard and self.heard[name].error:
            del self.heard[name]  # another thread may do better
        if name not in self.heard:
            if name not in (self._default, *self._look()):
                raise StoreError(f"there is no drill in {name}")
            if len(self.heard) >= MOST_DRILLS:
                self.tidy(0.0)
            if len(self.heard) >= MOST_DRILLS:
                raise StoreError(
                    f"{MOST_DRILLS} drills are shown already: close the pages of another one"
                )
            try:
                self.heard[name] = LiveDrill(name, self._finder.domain_id)
            except StartError as error:
                raise StoreError(str(error)) from None
        client.drill = name
        self._pages[id(client)] = self.heard[name]

    def hear(self) -> None:
        """Hear the drill of pages that name none, from now on and as long as this exists."""
        self._kept = self._default
        self.heard[self._kept] = LiveDrill(self._kept, self._finder.domain_id)

    def close(self, client: ClientState) -> None:
        """Note that a browser does not show its drill any more."""
        self._left_at[self._pages.pop(id(client)).namespace] = self._clock()

    def tidy(self, linger: float = LINGER) -> None:
        """Hear no more of drills that no page has shown for so long [s]."""
        shown = {self._kept, *(drill.namespace for drill in self._pages.values())}
        for name in set(self.heard) - shown:
            if self._clock() - self._left_at[name] >= linger:
                self.heard.pop(name).close()

    def end(self) -> None:
        """Hear no more of any drill."""
        for drill in self.heard.values():
            drill.close()
        self.heard.clear()

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return what has changed."""
        if self._clock() - self._looked >= _LOOK_PERIOD:
            self._look()
        return LiveFrame(self._pages[id(client)], client).fields(self._namespaces)

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Queue an action."""
        if name != "act":
            raise ParameterError(f"a running drill has no {shown(name)}")
        self._pages[id(client)].act(content["name"], content["arguments"])

    def listing(self) -> dict[str, Any]:
        """Return the drills of the domain for the list."""
        found = [
            {**asdict(drill), "path": drill_path(drill.namespace)}
            for drill in self._finder.drills()
        ]
        return {"domain": self._finder.domain_id, "drills": found}

    def _look(self) -> list[str]:
        self._looked = self._clock()
        self._namespaces = [drill.namespace for drill in self._finder.drills()]
        return self._namespaces


def serve_drills(
    place: Place,
    domain_id: int | None,
    namespace: str,
    announce: Callable[[PageServer, DrillFinder], object],
    prepare: Callable[[PageServer, LiveStore], object] = lambda server, store: None,
) -> None:
    """Serve the list of drills and a screen for each until SIGINT or SIGTERM.

    ``announce`` is called once the server listens, ``prepare`` before, such as to hear the drill
    from the beginning, or to let something else stop the server. A page without a namespace shows
    the drill of ``namespace``.
    """
    with DrillFinder(domain_id) as finder:
        store = LiveStore(finder, namespace)
        server = PageServer(store, place, store.listing)
        prepare(server, store)
        try:
            with server:
                announce(server, finder)
                server.run()
        finally:
            store.end()
