"""Progress is for people who wait: on a terminal, and of what takes long."""

import io
import sys
import time

import pytest

from rpud_sim.cli.progress import progress_bar


class Screen(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self._terminal = terminal

    def isatty(self):
        return self._terminal


@pytest.mark.parametrize(
    ("terminal", "waited", "shown"), [(True, 60.0, True), (True, 0.0, False), (False, 60.0, False)]
)
def test_a_bar_appears_on_a_terminal_for_what_takes_long(monkeypatch, terminal, waited, shown):
    screen = Screen(terminal)
    monkeypatch.setattr(sys, "stderr", screen)
    with progress_bar(" messages", 4000, scaled=True, title="reading") as bar:
        later = time.time() + waited
        monkeypatch.setattr(bar, "_time", lambda: later, raising=False)
        bar.update(2000)
    shows = screen.getvalue()
    assert ("reading: " in shows and "2.00k/4.00k" in shows) == shown
    assert bool(shows) == shown
