"""Session of the view in a terminal: logs wait until its end, and the terminal is restored."""

from __future__ import annotations

import os
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import closing, contextmanager

from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.watch.live_drill import LiveDrill
from rpud_sim.watch.terminal import TerminalView

_LOG_LINES = 20  # of what was logged meanwhile, shown at the end


def watch_in_terminal(namespace: str | None = None, domain_id: int | None = None) -> int:
    """Show a drill in this terminal until the user quits; return the exit code.

    Args:
        namespace: of the drill; None for the only one, or a list of them.
        domain_id: ROS domain; None for that of the environment.

    Raises:
        StartError: if ROS cannot start, or does not allow the namespace.
    """
    with closing(DrillFinder(domain_id)) as finder:
        view = TerminalView(lambda name: LiveDrill(name, domain_id), finder, namespace)
        with closing(view), _undisturbed():
            view.run(mouse=False)
        return view.return_code or 0


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Draw on standard output, and keep what is logged until the end: it would scroll the page."""
    screen = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="replace")
    before, errors = os.dup(2), sys.__stderr__
    with tempfile.TemporaryFile() as log, screen:
        os.dup2(log.fileno(), 2)
        sys.__stderr__ = screen  # type: ignore[misc] # where Textual draws
        try:
            yield
        finally:
            sys.__stderr__ = errors  # type: ignore[misc]
            sys.stderr.flush()
            os.dup2(before, 2)
            os.close(before)
            log.seek(0)
            for text in deque(log, _LOG_LINES):
                print(printable(text.decode(errors="replace").rstrip("\n")), file=sys.stderr)
