"""Screenshots of pages in Chromium, in light and in dark, as small PNG files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from toolchain.browser import NAMES, OPTIONS, find_chromium

SCHEMES = {"light": "", "dark": "_dark"}
"""Endings of the names of files, by colour scheme."""

_COLORS = 256
_DRAWN = "() => document.readyState === 'complete'"


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


def open_page(browser: Browser, url: str, size: tuple[int, int], scheme: str) -> Page:
    """Return a page in a colour scheme, in a window of so many pixels."""
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if scheme == "dark" else "light",
        reduced_motion="no-preference",
    )
    page.goto(url)
    page.wait_for_function(_DRAWN)
    return page


def save(page: Page, out: Path) -> None:
    """Write the screenshot of a page into a file, and close the page."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
    out.write_bytes(smaller(page.screenshot()))
    page.close()


def film(pictures: list[tuple[float, bytes]], out: Path) -> None:
    """Write pictures, with the times at which they were taken [s], as an animated WebP."""
    times = [round(1000 * time) for time, _ in pictures]
    first, *others = [Image.open(io.BytesIO(picture)).convert("RGB") for _, picture in pictures]
    shown = [after - before for before, after in pairwise(times)]
    first.save(
        out,
        save_all=True,
        append_images=others,
        duration=[*shown, 1000],
        loop=0,
        quality=30,
        method=4,
    )


def stacked(pictures: list[bytes]) -> bytes:
    """Return pictures of one width below each other."""
    images = [Image.open(io.BytesIO(picture)) for picture in pictures]
    whole = Image.new("RGB", (images[0].width, sum(image.height for image in images)))
    top = 0
    for image in images:
        whole.paste(image, (0, top))
        top += image.height
    buffer = io.BytesIO()
    whole.save(buffer, "png")
    return smaller(buffer.getvalue())


def smaller(picture: bytes) -> bytes:
    """Return a PNG file with a palette instead of full colours."""
    with Image.open(io.BytesIO(picture)) as image:
        colors = image.convert("RGB").quantize(_COLORS, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    colors.save(buffer, "png", optimize=True)
    return buffer.getvalue()
