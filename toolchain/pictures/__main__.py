"""Pictures of README and docs: `python -m toolchain.pictures DIR [NAME ...]`, or `make picture`.

Drawings have their numbers and motion from the code; pages are those that a reader sees, of runs
that are made for it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Browser
from playwright.sync_api import Error as BrowserError

from rpud_sim.foundation.terminal import complain
from toolchain.pictures.diagrams import draw_blocks, draw_drill, draw_events
from toolchain.pictures.screenshots import SCHEMES, chromium, shoot

CONFIG = Path(__file__).resolve().parents[2] / "config"
WIDE = (1200, 900)


def report(browser: Browser, out: Path, folder: Path) -> None:
    """Take the page of `rpud report`, of a run with the faults of config/faults.yaml."""
    bag, page = folder / "bags" / "drilled", folder / "report.html"
    scenario = f"scenario={CONFIG / 'faults.yaml'}"
    rpud("run", "--duration", "12", "--set", scenario, "--record", bag)
    rpud("report", bag, "--out", page)
    shoot(browser, page.as_uri(), out, WIDE)


DRAWINGS: dict[str, Callable[[], str]] = {
    "drill": draw_drill,
    "blocks": draw_blocks,
    "events": draw_events,
}
PAGES: dict[str, Callable[[Browser, Path, Path], None]] = {
    "report": report,
}
FILES = [
    *(f"{name}.svg" for name in DRAWINGS),
    *(f"{name}{ending}.png" for name in PAGES for ending in SCHEMES.values()),
]
"""Names of all pictures."""


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
