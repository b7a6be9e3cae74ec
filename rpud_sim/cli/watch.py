"""``rpud watch``: pages in the browser that show running drills and act on them, or show a bag."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import PLACE, command
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.options import option, positional
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.ros.client.listening_node import DrillFinder
    from rpud_sim.viewer.live import LiveStore
    from rpud_sim.viewer.server import PageServer

PORT = Quantity("", "a port", 0, 65535, whole=True)
DEFAULT_PORT = 8810  # as in rpud_sim.viewer.server, which needs Tornado
_SEARCH_TIME = 1.0  # for drills before the addresses are printed [s]
_SEARCH_PERIOD = 0.05  # s


@command(
    "watch",
    "--port 8810",
    "show running drills in the browser and act on them, or show a bag",
    "With BAG it shows that bag: a timeline, every signal, and exact waveforms rebuilt from the "
    "trajectory. It prints the address of the page, which only this machine can reach unless "
    "--address says otherwise. Other machines then need the token in the address.",
    PLACE,
    bag=positional("BAG", "show this bag, a folder or one file, without ROS", nargs="?"),
    port=option(DEFAULT_PORT, "port of the page, 0 for a free one", PORT, metavar="P"),
    address=option("127.0.0.1", "address to listen on; remote ones need the token", metavar="A"),
    open=option(False, "open the page in the browser"),
    beside_drill=option(False, argparse.SUPPRESS),  # as `rpud run` starts it
)
def _run(options: Any) -> int:
    return _watch_drills(options) if options.bag is None else _watch_bag(options, options.bag)


def _watch_bag(options: Any, bag: str) -> ExitCode:
    from rpud_sim.viewer.recorded import serve_bag
    from rpud_sim.viewer.server import Place

    def announce(server: PageServer) -> None:
        url = server.url("/screen")
        print(f"bag {printable(bag)}: {url}", flush=True)
        if options.open:
            _open_browser(url)

    serve_bag(bag, Place.of(options.port, options.address), announce)
    return ExitCode.DONE


def _watch_drills(options: Any) -> ExitCode:
    from rpud_sim.viewer.live import serve_drills
    from rpud_sim.viewer.server import Place

    def announce(server: PageServer, store: LiveStore) -> None:
        if options.beside_drill:  # hear all of the run
            store.hear()
        _announce(server, store.finder, options)

    place = Place.of(options.port, options.address)
    serve_drills(place, options.domain, options.namespace, announce)
    return ExitCode.DONE


def _announce(server: PageServer, finder: DrillFinder, options: Any) -> None:
    drills = [options.namespace] if options.beside_drill else _find(finder) or [options.namespace]
    urls = [server.url("/screen", namespace=drill) for drill in drills]
    for drill, url in zip(drills, urls, strict=True):
        print(f"drill {printable(drill)}: {url}", flush=True)
    if options.open:
        _open_browser(urls[0])


def _find(finder: DrillFinder) -> list[str]:
    end = time.monotonic() + _SEARCH_TIME
    found: list[str] = []
    while time.monotonic() < end:
        found = finder.drills()
        time.sleep(_SEARCH_PERIOD)
    return found


def _open_browser(url: str) -> None:
    """Open a page in the browser of the desktop; say so if there is none."""
    import webbrowser

    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        browser = None
    # A browser in the terminal would take it, and cannot show the page.
    if browser is None or type(browser) is webbrowser.GenericBrowser or not browser.open(url):
        complain("rpud watch", "no browser here: open the address yourself")
