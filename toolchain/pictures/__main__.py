"""Pictures of README and docs: `python -m toolchain.pictures DIR [NAME ...]`, or `make picture`.

Drawings have their numbers and motion from the code; pages are those that a reader sees, of runs
that are made for it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page
from playwright.sync_api import Error as BrowserError

from rpud_sim.foundation.terminal import complain
from toolchain.pictures.diagrams import draw_blocks, draw_drill, draw_events, draw_interface
from toolchain.pictures.screenshots import SCHEMES, chromium, film, open_in_both, save

STRATA = Path(__file__).resolve().parents[2] / "config" / "strata_example.yaml"
WIDE = (1400, 900)
SECONDS, RATE = 14, 4  # of the film: s, pictures a second


def act(pages: list[Page], seconds: float) -> None:
    """Do what a reader does at that moment of the film; the first page commands the drill."""
    for page in pages:
        if seconds == 2.0:
            page.get_by_role("spinbutton", name="weight on bit").fill("14")
        elif seconds == 6.0:
            page.get_by_role("button", name="Fault").click()
            page.get_by_label("kind").select_option("free_mass_jammed")
            page.get_by_label("duration [s]").fill("2")
        elif seconds == 7.5:
            page.keyboard.press("Enter" if page is pages[0] else "Escape")
    if seconds == 3.0:
        pages[0].get_by_role("button", name="Press").click()


def screen(browser: Browser, out: Path, folder: Path) -> None:
    """Film the screen of a drill in layers of rock, pressed harder and jammed; keep the end."""
    words = ("run", "--duration", "600", "--quiet", "--watch", "0", "--set", f"strata={STRATA}")
    with background(*words, folder=folder) as drill:
        pages = open_in_both(browser, printed_url(drill), WIDE, reduced_motion="no-preference")
        for page in pages:  # slow enough for the eye, at so few pictures a second
            page.get_by_label("motion that a second shows").select_option("1")
        pages[0].wait_for_timeout(8_000)
        pictures: list[list[bytes]] = [[] for _ in pages]
        begin = time.monotonic()
        for number in range(SECONDS * RATE):
            act(pages, number / RATE)
            for page, taken in zip(pages, pictures, strict=True):
                taken.append(page.screenshot())
            late = begin + (number + 1) / RATE - time.monotonic()
            pages[0].wait_for_timeout(max(0.0, 1e3 * late))
        for taken, ending in zip(pictures, SCHEMES.values(), strict=True):
            film(taken, out.with_name(f"{out.stem}{ending}.webp"), RATE)
        save(pages, out)


DRAWINGS: dict[str, Callable[[], str]] = {
    "interface": draw_interface,
    "drill": draw_drill,
    "blocks": draw_blocks,
    "events": draw_events,
}
PAGES: dict[str, Callable[[Browser, Path, Path], None]] = {"screen": screen}
KINDS = ("png", "webp")
FILES = [
    *(f"{name}.svg" for name in DRAWINGS),
    *(f"{name}{end}.{kind}" for name in PAGES for end in SCHEMES.values() for kind in KINDS),
]
"""Names of all pictures."""


@contextmanager
def background(*words: str, folder: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a command of `rpud` in a folder meanwhile; its output is a pipe."""
    command = [sys.executable, "-m", "rpud_sim.cli.main", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate()


def printed_url(process: subprocess.Popen[str]) -> str:
    """Return the first address that a command prints.

    Raises:
        OSError: if it ends without one.
    """
    for line in process.stdout or ():
        if found := re.search(r"http://\S+", line):
            return found[0]
    raise OSError(f"{' '.join(process.args[3:])} printed no address")


def main() -> int:
    """Make the pictures; return the exit code."""
    parser = argparse.ArgumentParser(prog="pictures", description="Make the pictures of the docs.")
    parser.add_argument("out", metavar="DIR", type=Path, help="folder of the pictures")
    parser.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help=f"of {', '.join([*DRAWINGS, *PAGES])}; default: all",
    )
    arguments = parser.parse_args()
    names = arguments.names or [*DRAWINGS, *PAGES]
    if unknown := set(names) - {*DRAWINGS, *PAGES}:
        parser.error(f"no picture {', '.join(sorted(unknown))}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    try:
        for name in names:
            if name in DRAWINGS:
                (arguments.out / f"{name}.svg").write_text(DRAWINGS[name](), encoding="utf-8")
            else:
                with chromium() as browser, tempfile.TemporaryDirectory() as folder:
                    PAGES[name](browser, arguments.out / f"{name}.png", Path(folder))
            print(f"{name} is made", file=sys.stderr)
    except (BrowserError, OSError, subprocess.CalledProcessError) as error:
        complain("pictures", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
