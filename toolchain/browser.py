"""Chromium for tests and pictures: where it is, and how it starts without a way to the network."""

from __future__ import annotations

import os
import shutil
import sys

NAMES = ("chromium", "chromium-browser", "google-chrome")

OPTIONS = [
    "--no-sandbox",  # root, as in a container of CI, has no other way
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",  # /dev/shm of a container is small, and a page then crashes
    "--disable-sync",
    "--no-first-run",
    # A name that resolves to nothing cannot be reached, by whatever part of the browser.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
]
"""Command line of Chromium."""


def find_chromium() -> str | None:
    """Return the path of an installed Chromium: ``CHROMIUM``, then by name; or None.

    Raises:
        FileNotFoundError: if ``CHROMIUM`` names no program.
    """
    named = os.environ.get("CHROMIUM")
    if named:
        found = shutil.which(named)
        if found is None:
            raise FileNotFoundError(f"CHROMIUM={named}: no such program")
        return found
    return next(filter(None, map(shutil.which, NAMES)), None)


def main() -> int:
    """Print where Chromium is; return 1 where there is none."""
    try:
        found = find_chromium()
    except FileNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    if found is not None:
        print(found)
    return int(found is None)


if __name__ == "__main__":
    sys.exit(main())
