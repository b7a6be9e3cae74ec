"""What the page of a bag needs: ``python -m bench.watch_bag BAG``, with Chromium and Playwright.

It starts ``rpud watch BAG``, opens the page, and prints the time from the start of the command to
the drawn page. Then it zooms to random places of the bag and prints the times from each request to
the drawn answer. The processor time of the server is beside them, because other work on the machine
does not change it much.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

from bench.machine import used_by
from toolchain.browser import OPTIONS, find_chromium

WIDTHS = (1000.0, 100.0, 10.0, 1.0, 0.05, 1e-3, 2e-5)
"""Ranges of time that are zoomed to [s]."""

_TIMEOUT = 120_000  # ms
_DRAWN = "document.documentElement.dataset.drawn === 'true'"
# Time from a new range to its answer, drawn: two frames after the data have come.
_ZOOM = """([start, end]) => new Promise((done) => {
  const began = performance.now();
  rpudPlots.setRange(rpudPlots.groups.get("time"), start, end);
  const look = () => {
    const answered = JSON.parse(document.documentElement.dataset.answered);
    const [from, to] = answered;
    if (from <= start && end <= to && to - from < 1.1 * (end - start))
      requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - began)));
    else setTimeout(look, 5);
  };
  setTimeout(look, 5);
})"""


def measure(bag: str, turns: int) -> None:
    """Print the times of one bag."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=find_chromium(), args=OPTIONS)
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(_TIMEOUT)
        print(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        began = time.perf_counter()
        server = subprocess.Popen(
            ["rpud", "watch", bag, "--port", "0"], stdout=subprocess.PIPE, text=True
        )
        try:
            assert server.stdout is not None
            address = re.search(r"http://\S+", server.stdout.readline())
            if address is None:
                raise SystemExit("rpud watch printed no address")
            listening, spent = time.perf_counter() - began, used_by(server.pid)
            print(
                f"start of the command to its address: {listening:.2f} s, processor {spent:.2f} s"
            )
            page.goto(address[0])
            page.wait_for_function(_DRAWN)
            page.evaluate("() => new Promise((done) => requestAnimationFrame(done))")
            opened, spent = time.perf_counter() - began, used_by(server.pid)
            print(
                f"start of the command to the drawn page: {opened:.2f} s, processor {spent:.2f} s"
            )
            _zoom(page, server.pid, turns, settled=False)
            page.wait_for_function(
                "document.getElementById('read').textContent.startsWith('The whole bag')",
                timeout=20 * _TIMEOUT,
            )
            print(f"the whole bag was read after {time.perf_counter() - began:.0f} s")
            _zoom(page, server.pid, turns, settled=True)
            status = Path(f"/proc/{server.pid}/status").read_text(encoding="utf-8")
            peak = re.search(r"VmHWM:\s+(\d+)", status)
            print(f"peak memory of the server: {int(peak[1]) / 1024 if peak else 0:.0f} MiB")
        finally:
            server.terminate()
            server.wait()
            browser.close()


def _zoom(page, process: int, turns: int, *, settled: bool) -> None:
    numbers = random.Random(1)
    whole = page.evaluate("rpudPlots.groups.get('time').whole")
    when = "after" if settled else "while"
    for width in WIDTHS:
        if width > whole[1]:
            continue
        times, spent = [], used_by(process)
        for _ in range(turns):
            start = numbers.uniform(whole[0], whole[1] - width)
            times.append(page.evaluate(_ZOOM, [start, start + width]))
        spent = (used_by(process) - spent) / turns
        share = "" if not settled else f", processor {1e3 * spent:.0f} ms each"
        figures = f"median {statistics.median(times):.0f} ms, greatest {max(times):.0f} ms"
        print(
            f"zoom to {width:g} s, {when} the bag is read: {figures} of {turns}{share}",
            flush=True,
        )


def main() -> int:
    """Measure; return the exit code."""
    parser = argparse.ArgumentParser(prog="watch_bag", description="Times of the page of a bag.")
    parser.add_argument("bag", metavar="BAG", help="such as one of an hour")
    parser.add_argument("--turns", type=int, default=5, help="zooms of each kind (default: 5)")
    arguments = parser.parse_args()
    measure(arguments.bag, arguments.turns)
    return 0


if __name__ == "__main__":
    sys.exit(main())
