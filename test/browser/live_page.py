"""The page of a running drill, as tests open and read it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import quote

from support import Process


@contextmanager
def served(namespace) -> Iterator[str]:
    """Serve the page of a drill while a test runs; the value is the address of the server."""
    with Process("rpud", "watch", "--port", "0", "--namespace", namespace) as running:
        yield running.wait_for_line(r"(http://[^/]+)/")[1]


def opened(page_of, server, namespace, **options):
    page = page_of(f"{server}/drill?namespace={quote(namespace)}", **options)
    page.until("Number(document.documentElement.dataset.frame) > 0")
    return page


def text_is(page, selector, text):
    page.until(f"document.querySelector({json.dumps(selector)}).textContent === {json.dumps(text)}")


def text_has(page, selector, pattern):
    page.until(
        f"new RegExp({json.dumps(pattern)}).test("
        f"document.querySelector({json.dumps(selector)}).textContent)"
    )


def exact(page, path):
    """Number behind a value of the page, in full precision."""
    return float(page.tab.get_attribute(f'output[data-value="{path}"]', "data-exact"))


def is_exact(page, path, value):
    page.until(
        f"Number(document.querySelector('output[data-value=\"{path}\"]').dataset.exact)"
        f" === {value!r}"
    )
