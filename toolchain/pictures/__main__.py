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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urljoin

from playwright.sync_api import Browser, Page
from playwright.sync_api import Error as BrowserError

from rpud_sim.foundation.terminal import complain
from toolchain.pictures.diagrams import draw_blocks, draw_drill, draw_events
from toolchain.pictures.screenshots import SCHEMES, chromium, open_in_both, save

CONFIG = Path(__file__).resolve().parents[2] / "config"
WIDE = (1200, 900)
TALL = (1200, 1670)


def report(browser: Browser, out: Path, folder: Path) -> None:
    """Take the page of `rpud report`, of a run with the faults of config/faults.yaml."""
    page = folder / "report.html"
    bag = record_faults(folder)
    rpud("report", bag, "--out", page)
    pages = open_in_both(browser, page.as_uri(), WIDE)
    for each in pages:
        show_plots(each)
    save(pages, out)


def live(browser: Browser, out: Path, folder: Path) -> None:
    """Take the page of `rpud watch`, of a drill that was pressed harder and jammed for a while."""
    with background("run", "--duration", "600"), background("watch", "--port", "0") as watch:
        url = urljoin(printed_url(watch), "/drill?namespace=/rpud")
        pages = open_in_both(browser, url, TALL)
        for page in pages:
            page.wait_for_function("document.querySelector('#state').textContent === 'running'")
        pages[0].wait_for_timeout(6_000)
        pages[0].get_by_role("spinbutton", name="weight on bit").fill("25")
        pages[0].get_by_role("button", name="Press").click()
        pages[0].wait_for_timeout(7_000)
        pages[0].get_by_role("combobox", name="fault").select_option("free_mass_jammed")
        pages[0].get_by_role("button", name="Inject").click()
        pages[0].wait_for_timeout(3_000)
        pages[0].get_by_role("button", name="Clear all").click()
        pages[0].wait_for_timeout(3_000)
        save(pages, out)


def bag(browser: Browser, out: Path, folder: Path) -> None:
    """Take the page of `rpud watch BAG`, zoomed into one contact of a run with faults."""
    recorded = record_faults(folder)
    with background("watch", recorded.name, "--port", "0", folder=folder) as watch:
        pages = open_in_both(browser, printed_url(watch), WIDE)
        for page in pages:
            page.wait_for_timeout(4_000)
            page.get_by_role("textbox", name="cursor").fill("3.3")
            page.get_by_role("button", name="next impact").click()
            page.wait_for_timeout(2_000)
            page.get_by_role("button", name="zoom to this contact").click()
            page.wait_for_timeout(4_000)
        save(pages, out)


def record_faults(folder: Path) -> Path:
    """Write the bag of a run with the faults of config/faults.yaml; it is the same every time."""
    recorded = folder / "drilled"
    scenario = f"scenario={CONFIG / 'faults.yaml'}"
    rpud("simulate", "--duration", "12", "--set", scenario, "--bag", recorded)
    return recorded


DRAWINGS: dict[str, Callable[[], str]] = {
    "drill": draw_drill,
    "blocks": draw_blocks,
    "events": draw_events,
}
PAGES: dict[str, Callable[[Browser, Path, Path], None]] = {
    "live": live,
    "bag": bag,
    "report": report,
}
FILES = [
    *(f"{name}.svg" for name in DRAWINGS),
    *(f"{name}{ending}.png" for name in PAGES for ending in SCHEMES.values()),
]
"""Names of all pictures."""


def show_plots(page: Page) -> None:
    """Bring the plots over time to the top of the window."""
    page.locator(".plot-controls").first.evaluate("(element) => element.scrollIntoView()")


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


def rpud(*words: object) -> None:
    """Run a command of `rpud`; what it prints goes to the terminal."""
    subprocess.run(
        [sys.executable, "-m", "rpud_sim.cli.main", *map(str, words)], check=True, stdout=sys.stderr
    )


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
