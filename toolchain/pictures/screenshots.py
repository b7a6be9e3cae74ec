"""Screenshots of pages in Chromium, in light and in dark, as small PNG files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from toolchain.browser import NAMES, OPTIONS, find_chromium

SCHEMES = {"light": "", "dark": "_dark"}
"""Endings of the names of files, by colour scheme."""

_COLORS = 256
_FILM_WIDTH = 960  # pixels
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


def open_in_both(
    browser: Browser,
    url: str,
    size: tuple[int, int],
    reduced_motion: Literal["reduce", "no-preference"] = "reduce",
) -> list[Page]:
    """Return a page in each colour scheme, in a window of so many pixels."""
    pages = []
    for scheme in SCHEMES:
        page = browser.new_page(
            viewport={"width": size[0], "height": size[1]},
            color_scheme=scheme,
            reduced_motion=reduced_motion,
        )
        page.goto(url)
        page.wait_for_function(_DRAWN)
        pages.append(page)
    return pages


def save(pages: list[Page], out: Path) -> list[Path]:
    """Write the screenshots of a page in each colour scheme; return the files.

    Args:
        pages: as ``open_in_both`` gives them.
        out: file of the first; the others are beside it.
    """
    files = []
    for page, ending in zip(pages, SCHEMES.values(), strict=True):
        page.wait_for_function(_DRAWN)
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done)))")
        files.append(out.with_name(f"{out.stem}{ending}.png"))
        files[-1].write_bytes(smaller(page.screenshot()))
        page.close()
    return files


def film(pictures: list[bytes], out: Path, rate: int) -> None:
    """Write pictures as an animated WebP, so many a second."""
    images = [Image.open(io.BytesIO(picture)).convert("RGB") for picture in pictures]
    height = round(_FILM_WIDTH * images[0].height / images[0].width)
    frames = [image.resize((_FILM_WIDTH, height)) for image in images]
    first, *others = frames
    first.save(
        out,
        save_all=True,
        append_images=others,
        duration=1000 // rate,
        loop=0,
        quality=35,
        method=4,
    )


def smaller(picture: bytes) -> bytes:
    """Return a PNG file with a palette instead of full colours."""
    with Image.open(io.BytesIO(picture)) as image:
        colors = image.convert("RGB").quantize(_COLORS, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    colors.save(buffer, "png", optimize=True)
    return buffer.getvalue()
