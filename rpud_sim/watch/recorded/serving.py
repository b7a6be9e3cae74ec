"""Serving of a bag's page until it is interrupted."""

from __future__ import annotations

import os
from collections.abc import Callable

from rpud_sim.watch.recorded.bag_page import bag_application
from rpud_sim.watch.recorded.bag_view import BagView
from rpud_sim.watch.server import PageServer, Place, serve

PATH = "/bag"  # path of the page on the server


def serve_bag(
    bag: str | os.PathLike[str], place: Place, announce: Callable[[PageServer], object]
) -> None:
    """Serve the page of a bag until SIGINT or SIGTERM; it reads the bag meanwhile.

    ``announce`` is called once the server listens, and prints ``server.url(PATH)``.
    """
    with BagView(os.fspath(bag)) as view:
        view.start()
        serve({PATH: bag_application(view)}, place, announce)
