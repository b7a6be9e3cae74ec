"""Report pages of bags, written beside the tests: a page takes longer than a test."""

from __future__ import annotations

import contextlib
import html
import subprocess
import sys
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

_TIME = 300.0  # that a page may take [s]


class ReportPages:
    """Pages that are being written, one at a time."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(1, "rpud_report")
        self._pages: list[Future[None]] = []

    def begin(self, bag: Path, page: Path) -> None:
        """Write the page of a bag soon; where that fails, the page's place has the reason."""
        self._pages.append(self._pool.submit(_write, bag, page))

    def finish(self) -> None:
        for page in self._pages:
            page.result()
        self._pool.shutdown()


def _write(bag: Path, page: Path) -> None:
    command = (sys.executable, "-m", "rpud_sim.cli.main", "report", str(bag), "--out", str(page))
    reason = ""
    with contextlib.suppress(FileNotFoundError):  # of a bag that the test itself has removed
        try:
            done = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_TIME,
            )
            reason = done.stderr.decode(errors="replace")
        except (OSError, subprocess.TimeoutExpired) as error:
            reason = str(error)
        if not page.exists():
            text = html.escape(f"The report could not be written: {reason}")
            page.write_text(f"<pre>{text}</pre>")
