"""Session of the view in a terminal: the terminal is checked before it, and restored after it."""

from __future__ import annotations

import os
import sys
import tempfile
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager

from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.watch.live_drill import LiveDrill
from rpud_sim.watch.terminal import TerminalView

_LOG_LINES = 20  # of what was logged meanwhile, shown at the end


class NoTerminalError(RuntimeError):
    """No terminal to draw on; the message is one line that says what to use instead."""


def check_terminal(environment: Mapping[str, str] = os.environ) -> None:
    """Check that there is a terminal to draw on.

    Raises:
        NoTerminalError: if input or output is none, or it cannot move its cursor.
    """
    instead = "use `rpud watch` in a browser, or `rpud echo status`"
    if not (os.isatty(0) and os.isatty(1)):
        raise NoTerminalError(f"--terminal needs a terminal for input and output: {instead}")
    if (kind := environment.get("TERM", "")) in ("", "dumb", "unknown"):
        raise NoTerminalError(f"TERM = {kind!r} is no terminal that can be drawn on: {instead}")


def watch_in_terminal(namespace: str | None = None, domain_id: int | None = None) -> int:
    """Show a drill in this terminal until the user quits; return the exit code.

    Args:
        namespace: of the drill; None for the only one, or a list of them.
        domain_id: ROS domain; None for that of the environment.

    Raises:
        NoTerminalError: if there is no terminal to draw on.
        StartError: if ROS cannot start, or does not allow the namespace.
    """
    check_terminal()
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
