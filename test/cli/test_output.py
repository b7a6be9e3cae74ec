"""Tables are aligned; progress is a bar on a terminal, and a line every ten seconds elsewhere."""

import io
import shutil
import sys
import time

import pytest

import rpud_sim.bag
from rpud_sim.cli.program import progress_bar
from rpud_sim.foundation.terminal import table


class Screen(io.StringIO):
    def __init__(self, terminal):
        super().__init__()
        self._terminal = terminal

    def isatty(self):
        return self._terminal


@pytest.fixture
def screen(monkeypatch):
    def make(terminal):
        screen = Screen(terminal)
        monkeypatch.setattr(sys, "stderr", screen)
        return screen

    return make


@pytest.fixture
def advance(monkeypatch):
    """Let the clock that a bar reads go on by some seconds."""
    ahead = [0.0]
    real = time.time
    monkeypatch.setattr("tqdm.std.time", lambda: real() + ahead[0])

    def go(seconds):
        ahead[0] += seconds

    return go


@pytest.mark.parametrize(("waited", "shown"), [(60.0, True), (0.0, False)])
def test_a_bar_appears_on_a_terminal_for_what_takes_long(screen, advance, waited, shown):
    terminal = screen(True)
    with progress_bar(" messages", 4000, scaled=True, title="reading") as bar:
        advance(waited)
        bar.update(2000)
        shows = terminal.getvalue()
    assert ("reading: " in shows and "2.00k/4.00k" in shows) == shown
    assert bool(shows) == shown


def test_elsewhere_a_line_is_written_every_ten_seconds(screen, advance):
    log = screen(False)
    with progress_bar(" messages", 4000, scaled=True, title="reading") as bar:
        for number in range(16):
            advance(2.0)
            bar.update(100)
            assert bool(log.getvalue()) == (number > 3)
    lines = log.getvalue().splitlines()
    assert [line.split(" [")[0] for line in lines] == [
        "reading:  12% 500/4.00k",
        "reading:  25% 1.00k/4.00k",
        "reading:  38% 1.50k/4.00k",
    ]
    assert all("messages/s]" in line and "\r" not in line for line in lines)
    assert log.getvalue().endswith("\n")


def test_a_table_is_aligned_after_escaping():
    assert table(("name", "n"), [("\x1b", 10)], left=1) == ["name   n", "\\x1b  10"]


def test_force_replaces_a_bag_and_keeps_it_if_the_command_fails(drill_bag, tmp_path, rpud):
    bag = tmp_path / "bag"
    shutil.copytree(drill_bag, bag)
    before = sorted(path.name for path in bag.iterdir())
    assert rpud("fork", drill_bag, "--at", "9", "--out", bag, "--force")[0] == 2
    assert sorted(path.name for path in bag.iterdir()) == before
    assert rpud("simulate", "--duration", "0.1", "--bag", bag, "--force")[0] == 0
    assert rpud_sim.bag.open(bag).duration < 0.2e9
    assert list(tmp_path.iterdir()) == [bag]


def test_force_overwrites_nothing_that_lies_where_it_puts_the_previous_output(
    drill_bag, tmp_path, rpud
):
    out, aside = tmp_path / "page.html", tmp_path / "page.html.replaced"
    out.write_text("mine")
    aside.write_text("also mine")
    code, _, errors = rpud("report", drill_bag, "--out", out, "--force")
    assert (code, errors.count("\n")) == (1, 1)
    assert f"{aside} exists already" in errors
    assert (out.read_text(), aside.read_text()) == ("mine", "also mine")
