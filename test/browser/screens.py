"""The screen of a drill or of a bag, as tests open and read it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import quote

from support import Process

SCREEN = "import('/share/screen.js').then(({ rpudScreen: screen }) => %s)"


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
    page.until(SCREEN % f"Boolean({condition})")


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
