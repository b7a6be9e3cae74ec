"""The screen of a drill or of a bag, as tests open and read it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import quote

from support import Process

import rpud_sim.viewer

SHARE = Path(rpud_sim.viewer.__file__).parent / "share"
SCREEN = "import('/share/screen.js').then(({ rpudScreen: screen }) => %s)"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@contextmanager
def page_with_share(folder, text) -> Iterator[str]:
    """Serve a page beside the screen's own files; the value is its address."""
    (folder / "share").symlink_to(SHARE)
    (folder / "index.html").write_text(text)
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=folder)) as server:
        Thread(target=server.serve_forever).start()
        yield f"http://127.0.0.1:{server.server_port}/index.html"
        server.shutdown()


@contextmanager
def served(namespace) -> Iterator[str]:
    """Serve the screens of drills while a test runs; the value is the address of the server."""
    with Process("rpud", "watch", "--port", "0", "--namespace", namespace) as running:
        yield running.wait_for_line(r"(http://[^/]+)/")[1]


def opened(page_of, server, namespace, **options):
    """Open the screen of a drill, which has heard of it."""
    page = page_of(f"{server}/screen?namespace={quote(namespace)}", **options)
    page.until("document.documentElement.dataset.connection === 'open'")
    until_screen(page, "screen.seen.now > 0")
    return page


def of_screen(page, expression):
    """Return an expression of ``screen``, the object behind the page."""
    return page.tab.evaluate(SCREEN % expression)


def until_screen(page, condition):
    """Wait for a condition; it does not hold while it looks at something that was not seen yet."""
    unseen = "(error) => { if (!(error instanceof TypeError)) throw error; }"
    page.until(f"{SCREEN % f'Boolean({condition})'}.catch({unseen})")


def text_is(page, selector, text):
    page.until(f"document.querySelector({json.dumps(selector)}).textContent === {json.dumps(text)}")


def text_has(page, selector, pattern):
    page.until(
        f"new RegExp({json.dumps(pattern)}).test("
        f"document.querySelector({json.dumps(selector)}).textContent)"
    )


def view_of(page):
    """Return the range of time in view [s]."""
    return of_screen(page, "[screen.range.start, screen.range.end]")


def drag(page, plot, first, last):
    """Drag the mouse over shares of the width of a plot."""
    box = page.tab.locator(f"{plot} .u-over").bounding_box()
    y = box["y"] + 0.5 * box["height"]
    page.tab.mouse.move(box["x"] + first * box["width"], y)
    page.tab.mouse.down()
    page.tab.mouse.move(box["x"] + last * box["width"], y, steps=4)
    page.tab.mouse.up()
