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

from playwright.sync_api import Browser
from playwright.sync_api import Error as BrowserError

from rpud_sim.foundation.terminal import print_error
from toolchain.pictures.diagrams import draw_blocks, draw_drill, draw_events, draw_interface
from toolchain.pictures.screenshots import SCHEMES, chromium, film, open_page, save, stacked

WIDE, NARROW = (1400, 900), (840, 640)  # windows of the picture and of the film [px]
SECONDS, RATE = 10, 12  # of the film: s, pictures a second
JAMMED = 2 * RATE  # picture at which `rpud inject` starts
# The film shows the section and two plots.
_CROP = """() => {
  const away = document.querySelectorAll(["header", "#bar", "#numbers", "#motion", ".section p",
    "[data-plot=load]", ".strip", "#details"]);
  for (const each of away) each.style.setProperty("display", "none", "important");
  const desk = document.querySelector(".desk");
  Object.assign(desk.style, { height: "100vh", gridTemplateColumns: "46% minmax(0, 1fr)" });
}"""


def screen(browser: Browser, out: Path, folder: Path) -> None:
    """Film the screen of a drill in layers of rock, whose free mass jams; keep the end."""
    for scheme, ending in SCHEMES.items():
        with background("run", "--quiet", "--watch", "0", folder=folder) as drill:
            url = printed_url(drill)
            page = open_page(browser, url, NARROW, scheme)
            page.wait_for_selector('html[data-heard="true"]')
            page.get_by_label("slow motion").select_option("2")
            page.wait_for_timeout(6_000)
            page.evaluate(_CROP)
            pictures: list[tuple[float, bytes]] = []
            begin = time.monotonic()
            for number in range(SECONDS * RATE):
                if number == JAMMED:
                    jam = start("inject", "free_mass_jammed", "--for", "2")
                taken = page.screenshot(type="jpeg", quality=95)
                pictures.append((time.monotonic() - begin, taken))
                late = begin + (number + 1) / RATE - time.monotonic()
                page.wait_for_timeout(max(0.0, 1e3 * late))
            jam.communicate()
            film(pictures, out.with_name(f"{out.stem}{ending}.webp"))
            page.close()
            page = open_page(browser, url, WIDE, scheme)
            page.wait_for_selector('html[data-heard="true"]')
            page.wait_for_timeout(6_000)
            save(page, out.with_name(f"{out.stem}{ending}.png"))


# What brings a drill into the next state, by the word of the state bar that follows.
STATES: dict[str, tuple[tuple[str, ...], ...]] = {
    "drilling": (),
    "jammed": (("inject", "free_mass_jammed"),),
    "off": (("clear", "all"), ("drive", "--off")),
    "paused": (("drive",), ("pause",)),
    "no contact": (("play",), ("engage", "--off")),
    "not connected": (),  # the drill is killed
}


def states(browser: Browser, out: Path, folder: Path) -> None:
    """Show the state bar in six states of a drill in layers of rock."""
    for scheme, ending in SCHEMES.items():
        shown = []
        with background("run", "--quiet", "--watch", "0", folder=folder) as drill:
            page = open_page(browser, printed_url(drill), NARROW, scheme)
            for word, acts in STATES.items():
                for act in acts:
                    start(*act).communicate()
                if word == "not connected":
                    drill.kill()
                page.wait_for_selector(f"#doing:text-is('{word}')")
                shown.append(page.locator("#bar").screenshot())
            page.close()
        out.with_name(f"{out.stem}{ending}.png").write_bytes(stacked(shown))


DRAWINGS: dict[str, Callable[[], str]] = {
    "interface": draw_interface,
    "drill": draw_drill,
    "blocks": draw_blocks,
    "events": draw_events,
}
PAGES: dict[str, Callable[[Browser, Path, Path], None]] = {"screen": screen, "states": states}
FILES = [
    *(f"{name}.svg" for name in DRAWINGS),
    *(f"{name}{end}.png" for name in PAGES for end in SCHEMES.values()),
    *(f"screen{end}.webp" for end in SCHEMES.values()),
]
"""Names of all pictures."""


def start(*words: str, folder: Path | None = None) -> subprocess.Popen[str]:
    """Start a command of `rpud` in a folder; its output is a pipe."""
    command = [sys.executable, "-m", "rpud_sim.cli.main", *words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder)


@contextmanager
def background(*words: str, folder: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """Run a command of `rpud` in a folder meanwhile; its output is a pipe."""
    process = start(*words, folder=folder)
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
        print_error("pictures", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
