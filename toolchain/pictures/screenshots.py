"""Screenshots of pages in Chromium, in light and in dark, as small PNG files."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from toolchain.browser import NAMES, OPTIONS, find_chromium

SCHEMES = {"light": "", "dark": "_dark"}
"""Endings of the names of files, by colour scheme."""

_COLORS = 256
_DRAWN = """() => document.readyState === 'complete'
    && (!window.Bokeh || Bokeh.documents.every((each) => each.is_idle))"""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Give a browser without a way to the network.

    Raises:
        FileNotFoundError: if there is none.
    """
    found = find_chromium()
    if found is None:
        raise FileNotFoundError(f"no Chromium: PATH has none of {', '.join(NAMES)}")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=OPTIONS)
        yield browser
        browser.close()


def shoot(
    browser: Browser,
    url: str,
    out: Path,
    size: tuple[int, int],
    prepare: Callable[[Page], None] = lambda page: None,
) -> list[Path]:
    """Write a page's screenshot in each colour scheme; return the files.

    Args:
        browser: that opens it.
        url: of the page.
        out: file of the light one; the dark one is beside it.
        size: width and height of the window [px].
        prepare: brings the page to what is to be seen.
    """
    files = []
    for scheme, ending in SCHEMES.items():
        page = browser.new_page(
            viewport={"width": size[0], "height": size[1]},
            color_scheme=scheme,
            reduced_motion="reduce",
        )
        page.goto(url)
        page.wait_for_function(_DRAWN)
        prepare(page)
        page.wait_for_function(_DRAWN)
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
        file = out.with_name(f"{out.stem}{ending}.png")
        file.write_bytes(smaller(page.screenshot()))
        page.close()
        files.append(file)
    return files


def smaller(picture: bytes) -> bytes:
    """Return a PNG file with a palette instead of full colours."""
    with Image.open(io.BytesIO(picture)) as image:
        colors = image.convert("RGB").quantize(_COLORS, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    colors.save(buffer, "png", optimize=True)
    return buffer.getvalue()
