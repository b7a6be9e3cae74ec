"""What the live page costs: lateness of the drill and load of the server with 0, 1 and 3 pages.

It needs a Chromium, whose own load is not counted.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack

from playwright.sync_api import sync_playwright

from bench.machine import used_by
from bench.row import Row, row
from rpud_sim.ros.client import DrillClient
from toolchain.browser import OPTIONS, find_chromium

SECONDS = 10.0
PAGES = (0, 1, 3)
_NAMESPACE = "/bench_watch"


def watch() -> Iterator[Row]:
    """Measure without a server, and with each number of pages."""
    rpud = (sys.executable, "-m", "rpud_sim.cli.main")
    with ExitStack() as stack:
        drill = subprocess.Popen(
            [*rpud, "run", "--quiet", "--namespace", _NAMESPACE], stdout=subprocess.DEVNULL
        )
        stack.callback(_end, drill)
        client = stack.enter_context(DrillClient(_NAMESPACE, node_name="bench", patience=100.0))
        client.found()
        yield row("watch, no server: lateness of the latest block", _lateness(client), "ms")
        server = subprocess.Popen(
            [*rpud, "watch", "--port", "0", "--namespace", _NAMESPACE],
            stdout=subprocess.PIPE,
            text=True,
        )
        stack.callback(_end, server)
        assert server.stdout is not None
        found = re.search(r"http://[^/]+", server.stdout.readline())
        assert found is not None, "the server does not start"
        url = f"{found[0]}/drill?namespace={_NAMESPACE}"
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=OPTIONS)
        stack.callback(browser.close)
        opened = 0
        for pages in PAGES:
            while opened < pages:
                page = browser.new_context().new_page()
                page.goto(url)
                page.wait_for_function("Number(document.documentElement.dataset.frame) > 0")
                opened += 1
            before, began = used_by(server.pid), time.monotonic()
            lateness = _lateness(client)
            load = (used_by(server.pid) - before) / (time.monotonic() - began)
            yield row(f"watch, {pages} pages: lateness of the latest block", lateness, "ms")
            yield row(f"watch, {pages} pages: server's share of one core", [100.0 * load], "%")


def _lateness(client: DrillClient) -> list[float]:
    """Return the lateness of the drill's latest block of each second [ms]."""
    found = []
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        count = client.status_number
        client.until(lambda count=count: client.status_number != count)  # type: ignore[misc]
        found.append(1e3 * client.status.lateness_max)
    return found


def _end(process: subprocess.Popen) -> None:
    process.terminate()
    process.wait(20.0)
