"""Drills that pages share: one thread hears each, however many pages show it."""

from __future__ import annotations

import time
from collections.abc import Callable, Container

from rpud_sim.viewer.live.live_drill import LiveDrill
from rpud_sim.viewer.store import StoreError

# How long a drill is heard after its last page has gone: a page may be loaded again [s].
LINGER = 120.0

MOST_DRILLS = 16


class DrillPool:
    """Drills by namespace; use it from one thread.

    ``known`` gives the namespaces that may be heard, ``clock`` the present time [s].
    """

    def __init__(
        self,
        known: Callable[[], Container[str]],
        domain_id: int | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._known = known
        self._domain = domain_id
        self._clock = clock
        self._drills: dict[str, LiveDrill] = {}
        self._pages: dict[str, int] = {}
        self._left_at: dict[str, float] = {}

    def take(self, namespace: str) -> LiveDrill:
        """Return the drill of a namespace for one more page; raise if it is unknown or too many."""
        name = f"/{namespace.strip('/')}"
        if name not in self._drills:
            if name not in self._known():
                raise StoreError(f"there is no drill in {name}")
            if len(self._drills) >= MOST_DRILLS:
                self.close_unused(0.0)
            if len(self._drills) >= MOST_DRILLS:
                raise StoreError(
                    f"{MOST_DRILLS} drills are shown already: close the pages of another one"
                )
            self._drills[name] = LiveDrill(name, self._domain)
        self._pages[name] = self._pages.get(name, 0) + 1
        return self._drills[name]

    def release(self, drill: LiveDrill) -> None:
        self._pages[drill.namespace] -= 1
        self._left_at[drill.namespace] = self._clock()

    def close_unused(self, linger: float = LINGER) -> None:
        """Hear no more of drills that no page has shown for so long [s]."""
        now = self._clock()
        for name in [name for name, pages in self._pages.items() if not pages]:
            if now - self._left_at[name] >= linger:
                del self._pages[name], self._left_at[name]
                self._drills.pop(name).close()

    def close(self) -> None:
        """Hear no more of any drill."""
        for drill in self._drills.values():
            drill.close()
        self._drills.clear()
        self._pages.clear()
