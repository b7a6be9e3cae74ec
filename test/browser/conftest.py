"""Fixtures for tests in a real Chromium; browser_pages.py shows how to use them.

Without a browser the tests are skipped; where `CI` is set, or RPUD_BROWSER=required as .ci/run
has it, they fail. Screenshots go to `browser` in the folder of artefacts (--rpud-artefacts).
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from browser_pages import HEIGHT, WIDE, BrowserPage, require_browser
from support import PATIENCE

from toolchain.browser import OPTIONS, find_chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_FAILED = pytest.StashKey[bool]()


@pytest.fixture(scope="session")
def a_browser_is_there() -> None:
    require_browser()


# Playwright leaves its event loop running in this thread between two calls. Other tests of a
# session have loops of their own, so a browser ends with its module.
@pytest.fixture(scope="module")
def browser(a_browser_is_there: None) -> Iterator[Browser]:
    """Chromium, for the tests of one file; it ends with them, and whenever this process does."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_chromium(), args=OPTIONS, timeout=PATIENCE * 1e3
        )
        yield browser
        browser.close()


@pytest.fixture
def artefacts(request: pytest.FixtureRequest) -> Path:
    """Folder of this test's screenshots, which does not exist yet."""
    name = request.config.getoption("rpud_artefacts")
    test = re.sub(r"[^\w.=+-]+", "_", request.node.nodeid.rpartition("browser/")[2])[-150:]
    if not name:
        return request.getfixturevalue("tmp_path") / "browser" / test
    return Path(request.config.rootpath, name, "browser", test)


@pytest.fixture
def page_of(
    browser: Browser, artefacts: Path, request: pytest.FixtureRequest
) -> Iterator[Callable[..., BrowserPage]]:
    """Open pages, each for a reader of its own: `page_of(path_or_url, width=1400, ...)`.

    Options: `width` [px], `scheme` (light, dark, no-preference), `reduced_motion`, and others of
    Playwright's `new_context`. A test that fails leaves a screenshot of each.
    """
    from playwright.sync_api import Error

    opened: list[BrowserPage] = []

    def open_page(
        target: Path | str,
        *,
        width: int = WIDE,
        scheme: str = "light",
        reduced_motion: bool = False,
        **options: object,
    ) -> BrowserPage:
        context = browser.new_context(
            viewport={"width": width, "height": HEIGHT},
            color_scheme=scheme,
            reduced_motion="reduce" if reduced_motion else "no-preference",
            **options,
        )
        context.set_default_timeout(PATIENCE * 1e3)
        page = BrowserPage(context, target, artefacts)
        opened.append(page)
        return page

    yield open_page
    for number, page in enumerate(opened, 1):
        with contextlib.suppress(Error):  # it is closed, or the browser is gone
            if request.node.stash.get(_FAILED, False):
                page.keep(f"failed_{number}")
            page.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo) -> Iterator[None]:
    """Tell the fixtures whether their test failed."""
    report = yield
    item.stash[_FAILED] = item.stash.get(_FAILED, False) or report.failed
    return report
