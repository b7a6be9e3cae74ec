"""Store of the running drills of a ROS domain."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any
from urllib.parse import urlencode

from rpud_sim.foundation.quantities import ParameterError, shown
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.viewer.live.drill_pool import DrillPool
from rpud_sim.viewer.live.live_drill import LiveDrill
from rpud_sim.viewer.live.live_frame import LiveFrame
from rpud_sim.viewer.server import PageServer, Place
from rpud_sim.viewer.store import ClientState

_LOOK_PERIOD = 3.0  # between looks at the namespaces [s]
_REAP_PERIOD = 10.0  # between looks at drills that no page shows [s]


def drill_path(namespace: str) -> str:
    """Return the address of a drill's screen on the server."""
    return f"/screen?{urlencode({'namespace': namespace}, safe='/')}"


class LiveStore:
    """Drills of a domain, each heard while a page shows it.

    A page that names no drill shows that of ``namespace``, which may start later.
    """

    mode = "live"

    def __init__(self, finder: DrillFinder, namespace: str) -> None:
        self._finder = finder
        self._default = f"/{namespace.strip('/')}"
        self._namespaces: list[str] = []
        self._looked = -_LOOK_PERIOD
        self._drills: dict[int, LiveDrill] = {}  # by browser
        self.pool = DrillPool(
            lambda: {self._default, *(drill.namespace for drill in finder.drills())},
            finder.domain_id,
        )

    def open(self, client: ClientState) -> None:
        """Hear the drill that a browser shows."""
        drill = self.pool.take(client.drill or self._default)
        client.drill = drill.namespace
        self._drills[id(client)] = drill

    def close(self, client: ClientState) -> None:
        """Note that a browser does not show its drill any more."""
        self.pool.release(self._drills.pop(id(client)))

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return what has changed."""
        if (now := time.monotonic()) - self._looked >= _LOOK_PERIOD:
            self._looked = now
            self._namespaces = [drill.namespace for drill in self._finder.drills()]
        return LiveFrame(self._drills[id(client)], client).fields(self._namespaces)

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Queue an action."""
        if name != "act":
            raise ParameterError(f"a running drill has no {shown(name)}")
        self._drills[id(client)].act(content["name"], content["arguments"])

    def listing(self) -> dict[str, Any]:
        """Return the drills of the domain for the list."""
        found = [
            {
                **{
                    name: printable(value) if isinstance(value, str) else value
                    for name, value in asdict(drill).items()
                },
                "path": drill_path(drill.namespace),
            }
            for drill in self._finder.drills()
        ]
        return {"domain": self._finder.domain_id, "drills": found}


def serve_drills(
    place: Place,
    domain_id: int | None,
    namespace: str,
    announce: Callable[[PageServer, DrillFinder], object],
    prepare: Callable[[PageServer], object] = lambda server: None,
) -> None:
    """Serve the list of drills and a screen for each until SIGINT or SIGTERM.

    ``announce`` is called once the server listens, ``prepare`` before, such as to let something
    else stop the server. A page without a namespace shows the drill of ``namespace``.
    """
    with DrillFinder(domain_id) as finder:
        store = LiveStore(finder, namespace)
        server = PageServer(store, place, store.listing)
        prepare(server)
        server.every(_REAP_PERIOD, store.pool.close_unused)
        try:
            with server:
                announce(server, finder)
                server.run()
        finally:
            store.pool.close()
