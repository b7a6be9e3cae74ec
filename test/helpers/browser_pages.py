"""What a test sees of a page in Chromium; the fixture `page_of` of conftest.py makes it.

    def test_the_button_steps_the_drill(page_of):
        page = page_of("http://127.0.0.1:8080/rpud")  # or a file: page_of(tmp_path / "report.html")
        page.tab.get_by_role("button", name="Step").click()  # `tab` is Playwright's Page
        page.until("document.querySelector('#time').textContent === '0.010 s'")
        page.keep("stepped")  # a screenshot among the artefacts
        page.assert_quiet()  # no error on the console, no request off the machine
        page.assert_fits()  # no scrolling sideways
        page.assert_described()  # all that is seen has a text
        page.assert_accessible()  # axe-core finds nothing serious
        page_of(page.url, width=PHONE, scheme="dark", reduced_motion=True)  # once more

`page.check()` is all four. `WIDE` and `PHONE` are widths in pixels, SCHEMES the colour schemes.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest
from support import PATIENCE

from toolchain.browser import NAMES, find_chromium

if TYPE_CHECKING:  # where they are not installed, the tests are skipped
    from playwright.sync_api import BrowserContext, ConsoleMessage, Page

WIDE, PHONE = 1400, 375
SCHEMES = ("light", "dark")
HEIGHT = 900

_HIGHEST = 8000  # a screenshot [px]: of a higher page, that of the window
_LOCAL = ("", "127.0.0.1", "localhost")
_SERIOUS = ("serious", "critical")
_ALWAYS = ("landmark-one-main", "page-has-heading-one", "region")  # axe says moderate

# An element with a text of its own, or inside a described figure, needs no other.
_UNDESCRIBED = """() => {
  const spoken = (e) => e.closest('[aria-hidden="true"], [role="presentation"], [role="none"]')
    || e.getAttribute('alt') !== null || e.getAttribute('aria-label')
    || e.getAttribute('aria-labelledby') || e.querySelector(':scope > title');
  const around = 'figure, [role="img"], [role="figure"], [role="group"], [role="application"]';
  const named = (e) => e && (spoken(e) || e.querySelector('figcaption'));
  return [...document.querySelectorAll('img, svg, canvas')].filter((e) => !e.closest('svg svg')
    && !spoken(e) && !named(e.closest(around)) && e.getClientRects().length)
    .map((e) => e.outerHTML.slice(0, 120));
}"""

_OVERFLOWING = """() => {
  const root = document.documentElement;
  const width = root.clientWidth, needed = Math.max(root.scrollWidth, document.body.scrollWidth);
  const right = (e) => e.getBoundingClientRect().right;
  if (needed <= width) return [];
  const wide = [...document.body.querySelectorAll('*')].filter((e) => right(e) > width + 0.5);
  return [`the page needs ${needed} px of ${width}`, ...wide.slice(0, 8).map(
    (e) => `${e.outerHTML.slice(0, 100)} ends at ${right(e)}`)];
}"""


class BrowserPage:
    """A page as one reader sees it: a window, a colour scheme, and all that it complained of.

    Args:
        context: of Playwright, for this page alone.
        target: file or address.
        artefacts: folder of the test's screenshots; it is made when there is one.
    """

    def __init__(self, context: BrowserContext, target: Path | str, artefacts: Path) -> None:
        self._context, self._artefacts = context, artefacts
        self.errors: list[str] = []
        self.off_machine: list[str] = []
        self.url = target.absolute().as_uri() if isinstance(target, Path) else target
        context.on("request", lambda request: self._ask(request.url))
        self.tab: Page = context.new_page()
        self.tab.on("console", self._hear)
        self.tab.on("pageerror", lambda error: self.errors.append(f"uncaught: {error}"))
        self.tab.on("crash", lambda _: self.errors.append("the page crashed"))
        self.tab.on("websocket", lambda socket: self._ask(socket.url))
        self.tab.goto(self.url)

    def _ask(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("data", "blob", "about") and parts.hostname not in (None, *_LOCAL):
            self.off_machine.append(url)

    def _hear(self, message: ConsoleMessage) -> None:
        # Browsers request an icon by themselves; no page of ours has one.
        if message.type == "error" and not message.location["url"].endswith("/favicon.ico"):
            self.errors.append(message.text)

    def show(self, scheme: str) -> None:
        """Change the reader's colour scheme while the page is open."""
        self.tab.emulate_media(color_scheme=scheme)

    def until(self, condition: str) -> None:
        """Wait until an expression of JavaScript is true; Playwright's TimeoutError otherwise."""
        # Playwright's own wait compiles a text in the page, which the policy of our pages forbids.
        end = time.monotonic() + PATIENCE
        while not self.tab.evaluate(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"after {PATIENCE} s it is still not true that {condition}")
            self.tab.wait_for_timeout(50)

    def settle(self) -> None:
        """Wait until all is drawn, fonts too."""
        self.until("document.readyState === 'complete' && document.fonts.status === 'loaded'")
        self.tab.evaluate("() => new Promise((f) => requestAnimationFrame(() => setTimeout(f)))")

    def keep(self, name: str, *, whole: bool = True) -> Path:
        """Write a screenshot among the artefacts of the test, and return its path."""
        whole = whole and self.tab.evaluate("document.body.scrollHeight") < _HIGHEST
        path = self._artefacts / f"{re.sub(r'[^-+=.a-zA-Z0-9_]+', '_', name)}.png"
        self.tab.screenshot(path=path, full_page=whole)
        return path

    def assert_quiet(self) -> None:
        """Fail if the console had an error, or if the page sent a request to another machine."""
        found = [*self.errors, *(f"request to another machine: {url}" for url in self.off_machine)]
        assert not found, "\n".join(found)

    def assert_fits(self) -> None:
        """Fail where the page scrolls sideways."""
        found = self.tab.evaluate(_OVERFLOWING)
        assert not found, "\n".join(found)

    def assert_described(self) -> None:
        """Fail where an image, a drawing or a plot has no text for those who do not see it."""
        found = self.tab.evaluate(_UNDESCRIBED)
        assert not found, "without an alternative text:\n" + "\n".join(found)

    def assert_accessible(self) -> None:
        """Fail where axe-core finds what is serious or critical, or a page without landmarks."""
        from axe_playwright_python.sync_playwright import Axe

        found = Axe().run(self.tab).response["violations"]
        worst = [one for one in found if one["impact"] in _SERIOUS or one["id"] in _ALWAYS]
        lines = [f"{one['impact']}: {one['help']} ({one['helpUrl']})" for one in worst]
        for one, line in zip(worst, lines, strict=True):
            nodes = one["nodes"][:5]
            print(line, *(f"  {node['target']} {node['html'][:150]}" for node in nodes), sep="\n")
            print(*(f"  {check['message']}" for node in nodes for check in node["any"]), sep="\n")
        assert not lines, "\n".join(lines)

    def check(self) -> None:
        """Check all that every page of the project has to keep."""
        self.settle()
        self.assert_fits()
        self.assert_described()
        self.assert_accessible()
        self.assert_quiet()

    def close(self) -> None:
        """Close the page and all that belongs to it."""
        self._context.close()


def require_browser() -> None:
    """Skip the test, or fail it in CI, where there is no browser."""
    try:
        import axe_playwright_python  # noqa: F401
        import playwright  # noqa: F401
    except ImportError as error:
        missing = f"{error}: `make test-all` installs toolchain/requirements/browser.lock"
    else:
        if find_chromium() is not None:
            return
        missing = f"no Chromium: CHROMIUM is not set, and PATH has none of {', '.join(NAMES)}"
    if "CI" in os.environ or os.environ.get("RPUD_BROWSER") == "required":
        pytest.fail(f"tests in a browser are never skipped in CI: {missing}", pytrace=False)
    pytest.skip(missing)
