"""Server of the pages of all drills of a domain."""

from __future__ import annotations

from collections.abc import Callable

from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.watch.drill_list import ListData, ListPage
from rpud_sim.watch.drill_pool import DrillPool
from rpud_sim.watch.live_page import live_application
from rpud_sim.watch.server import PageServer, Place

_REAP_PERIOD = 10.0  # between looks at drills that no page shows [s]


def serve_drills(
    place: Place,
    domain_id: int | None,
    namespace: str,
    announce: Callable[[PageServer, DrillFinder], object],
    prepare: Callable[[PageServer], object] = lambda server: None,
) -> None:
    """Serve the list of drills and a page for each until SIGINT or SIGTERM.

    ``announce`` is called once the server listens, ``prepare`` before, such as to let something
    else stop the server. A page without a namespace shows the drill of ``namespace``.
    """
    with DrillFinder(domain_id) as finder:
        first = f"/{namespace.strip('/')}"  # which may start later
        pool = DrillPool(
            lambda: {first, *(drill.namespace for drill in finder.drills())}, domain_id
        )
        options = {"finder": finder}
        server = PageServer(
            {"/drill": live_application(pool.take, pool.release, lambda: namespace)},
            place,
            [("/", ListPage, options), ("/drills", ListData, options)],
        )
        prepare(server)
        server.every(_REAP_PERIOD, pool.close_unused)
        try:
            with server:
                announce(server, finder)
                server.run()
        finally:
            pool.close()
