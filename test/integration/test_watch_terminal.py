"""`rpud watch --terminal` beside a real drill: numbers, keys, refusals, and the terminal itself."""

import asyncio
import os
import re
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from drill_client import SECOND, nanoseconds, stamps
from pseudo_terminal import PseudoTerminal
from support import PATIENCE

from rpud_sim.ros.client.drill_finder import DrillFinder
from rpud_sim.watch.live_drill import LiveDrill
from rpud_sim.watch.terminal import TerminalView

BIN = SECOND // 20


class Seat:
    """An operator in front of a view: presses keys and looks at the page."""

    def __init__(self, view, pilot):
        self.view, self.pilot = view, pilot

    async def until(self, condition, what="it"):
        deadline = time.monotonic() + PATIENCE
        while not (value := condition()):
            assert time.monotonic() < deadline, f"{what} did not come true; the page:\n{self.page}"
            await self.pilot.pause(0.02)
        return value

    async def sees(self, text):
        """Wait until a text stands on the page."""
        await self.until(lambda: text in self.page, repr(text))

    async def key(self, key, answer=None):
        """Press a key, and answer what it asks."""
        await self.pilot.press(key)
        if answer is not None:
            field = self.view.query_one("#answer")
            await self.until(lambda: field.has_focus)
            field.value = ""
            await self.pilot.press(*answer, "enter")

    @property
    def page(self):
        return self.view.shown

    @property
    def hint(self):
        return str(self.view.query_one("#hint").content)


def seated(namespace, act, size=(80, 24)):
    """Let an operator act in front of a view of a drill."""

    async def sit():
        with ExitStack() as stack:
            finder = stack.enter_context(DrillFinder())
            view = TerminalView(LiveDrill, finder, namespace, updates=20.0)
            stack.callback(view.close)
            async with view.run_test(size=size) as pilot:
                await act(Seat(view, pilot))
            return view

    return asyncio.run(sit())


@pytest.fixture(scope="module")
def paused(start_module_drill):
    """A drill that stands still, with a rock."""
    return start_module_drill(
        "/desk",
        publish_clock=True,
        start_paused=True,
        rock_model="specific_energy",
        weight_on_bit=10.0,
    )


@pytest.fixture
def client(paused, connect):
    return connect("/desk")


def latest(client):
    return client.status[-1]


def test_the_numbers_are_those_on_the_topics(client):
    heard = client.listen("contact_force")
    client.begin()
    origin = stamps(client.status[-1:])[0]

    async def look(seat):
        await seat.sees("paused")
        heard.clear()
        await seat.key("s", "2")
        await seat.sees("step 2.0: done")
        end = origin + 2 * SECOND
        client.until(lambda: stamps(client.status[-1:])[0] == end)
        await seat.until(lambda: seat.view.picture.time == 2.0)
        last = seat.view.picture.impact.sequence
        client.until(lambda: heard and heard[-1].sequence >= last)
        await seat.until(lambda: len(seat.view.picture.series.rows) == 41)
        status = client.status[-1]
        second = [m for m in heard if end - SECOND <= nanoseconds(m.header.stamp) < end]
        impact_rate, peak = len(second), max(message.peak_force for message in second)
        for text in (
            "paused   drilling   2.0 s",
            "10 N                  since 0.000 s",
            f"{status.drive_voltage:.4g} V {status.drive_frequency:.6g} Hz",
            f"depth {1e3 * status.depth:.2f} mm, {1e3 * status.penetration_rate:.3f} mm/s",
            f"vibration {1e6 * status.vibration_amplitude:.2f} um",
            f"actuator {status.actuator_power:.2f} W",
            f"tool and rock {status.absorbed_power:.2f} W",
            f"{impact_rate} /s",
            f"{peak:.0f} N",
            f"{status.deadlines_missed} deadlines missed",
            "no message lost",
        ):
            await seat.sees(text)
        assert impact_rate > 100

    seated("/desk", look)


def test_each_key_does_what_it_says(client):
    client.begin()

    async def act(seat):
        await seat.sees("paused")
        await seat.key("p", "25")
        await seat.sees("press 25.0: done")
        client.until(lambda: latest(client).weight_on_bit == 25.0)
        await seat.sees("25 N ")
        await seat.key("d", "80 15900")
        await seat.sees("drive enabled=True voltage=80 frequency=15900: done")
        client.until(lambda: latest(client).drive_voltage == 80.0)
        client.until(lambda: latest(client).drive_frequency == 15900.0)
        await seat.key("d", "off")
        await seat.sees("drive           off ")
        client.until(lambda: not latest(client).drive_enabled)
        await seat.key("e")
        await seat.sees("paused   free")
        client.until(lambda: latest(client).regime == "free")
        await seat.key("e")
        await seat.sees("paused   drilling")
        await seat.key("s", "0.5")
        await seat.sees("step 0.5: done")
        await seat.key("i", "hard_rock magnitude=3 for=9")
        await seat.sees("1 hard_rock  from 0.500 s on  magnitude 3")
        await seat.key("i", "bias wrench")
        await seat.sees("2 bias on wrench  from 0.500 s on")
        client.until(lambda: latest(client).active_faults == 2)
        await seat.key("c", "1")
        await seat.sees("1 hard_rock  from 0.500 s to 0.500 s")
        await seat.key("c", "all")
        await seat.sees("faults: 0 now, 2 over")
        client.until(lambda: latest(client).active_faults == 0)
        await seat.key("space")
        client.until(lambda: latest(client).state == "running")
        await seat.sees("running")
        await seat.key("space")
        client.until(lambda: latest(client).state == "paused")
        await seat.key("r", "all")
        await seat.sees("reset all: done")
        client.until(lambda: latest(client).commands_accepted == 0)
        await seat.sees("no faults")
        await seat.key("q")

    assert seated("/desk", act).return_code == 0


def test_a_refused_command_shows_the_drills_reason_and_a_wrong_answer_its_own(client):
    client.begin()

    async def act(seat):
        await seat.sees("paused")
        await seat.key("p", "-5")
        reason = "weight_on_bit = -5 N is outside its range [0, 1000] N"
        await seat.sees(f"press -5.0: refused: {reason}")
        await seat.sees("1 refused")
        client.until(lambda: latest(client).commands_rejected == 1)
        await seat.key("p", "much")
        await seat.until(lambda: "force = 'much' is not a number" in seat.hint)
        await seat.key("i", "hard_rok")
        await seat.sees("inject hard_rok: refused: ")
        await seat.sees("hard_rock")  # did you mean
        # While it runs, a step is refused; what others are refused is shown as well.
        await seat.key("space")
        await seat.sees("running")
        await seat.key("s", "0.1")
        await seat.sees("step 0.1: refused: ")
        await seat.key("space")
        await seat.sees("paused")
        await seat.key("p")
        await seat.pilot.press("escape")
        await seat.until(lambda: not seat.view.query_one("#prompt").display)
        client.until(lambda: latest(client).weight_on_bit == 10.0)

    seated("/desk", act)


def test_on_an_arm_a_key_commands_the_feed_and_the_drill_rejects_a_weight_on_bit(
    start_drill, connect
):
    start_drill("/arm", publish_clock=True, start_paused=True, feed_model="arm")
    client = connect("/arm")
    client.begin()

    async def act(seat):
        await seat.sees("paused")
        await seat.until(lambda: "f feed" in str(seat.view.query_one("#keys").content))
        await seat.key("f", "0.0005")
        await seat.sees("feed rate=0.0005: done")
        client.until(lambda: (latest(client).feed_mode, latest(client).feed_value) == (0, 0.0005))
        await seat.key("s", "0.1")
        await seat.sees("0.5 mm/s at ")
        await seat.key("f", "to 0.01")
        await seat.sees("feed position=0.01: done")
        client.until(lambda: (latest(client).feed_mode, latest(client).feed_value) == (1, 0.01))
        await seat.key("f", "0.9")
        await seat.sees("feed rate=0.9: refused: ")
        await seat.key("f", "fast")
        await seat.until(lambda: "rate = 'fast' is not a number" in seat.hint)
        await seat.key("p", "25")
        await seat.sees("press 25.0: refused: weight_on_bit cannot be commanded with")
        client.until(lambda: latest(client).commands_rejected == 2)
        assert (latest(client).feed_mode, latest(client).feed_value) == (1, 0.01)

    seated("/arm", act)


def test_without_an_arm_the_drill_rejects_a_feed(client):
    client.begin()

    async def act(seat):
        await seat.sees("paused")
        await seat.until(lambda: "p press" in str(seat.view.query_one("#keys").content))
        await seat.key("f", "0.0005")
        reason = "a feed cannot be commanded with feed_model = none"
        await seat.sees("feed rate=0.0005: refused: ")
        await seat.until(lambda: reason in " ".join(seat.page.split()), reason)

    seated("/desk", act)


def test_a_drill_that_vanishes_and_returns_has_a_banner(start_drill):
    first = start_drill("/lost", start_paused=True, weight_on_bit=11.0)

    async def look(seat):
        await seat.sees("11 N ")
        first.stop()
        await seat.sees("vanished: the drill in /lost is gone")
        assert "11 N " in seat.page
        start_drill("/lost", start_paused=True, weight_on_bit=12.0)
        await seat.sees("12 N ")
        await seat.until(lambda: "vanished" not in seat.page, "the return")

    seated("/lost", look)


def test_the_page_of_the_documentation_is_what_is_shown(client):
    client.begin()
    page = (Path(__file__).parents[2] / "docs/how-to/watch-in-a-terminal.md").read_text()
    (block,) = re.findall("```text\n(.*?)```", page, re.DOTALL)

    async def act(seat):
        await seat.sees("paused")
        await seat.key("p", "20")
        await seat.sees("press 20.0: done")
        await seat.key("s", "3")
        await seat.sees("step 3.0: done")
        await seat.key("i", "hard_rock magnitude=2")
        await seat.sees("1 hard_rock")
        await seat.key("s", "1")
        await seat.sees("step 1.0: done")
        await seat.key("p", "-5")
        await seat.sees("press -5.0: refused")
        await seat.sees("1 refused")
        await seat.until(lambda: seat.view.picture.time == 4.0)
        keys = str(seat.view.query_one("#keys").content)
        beside = "2 publishers command at once"  # the client of this test is the other one
        await seat.until(
            lambda: shape(f"{seat.page.replace(beside, '')}\n{keys}") == shape(block), shape(block)
        )

    seated("/desk", act)


def shape(page):
    """Return a page with every number, course and width alike."""
    words = [re.sub(r"-?\d+(\.\d+)?", "0", word) for word in re.sub("[▁-█]", "", page).split()]
    return " ".join(words)


def test_of_several_drills_there_is_a_list_and_a_number_chooses(paused, start_drill):
    start_drill("/other", start_paused=True, weight_on_bit=13.0)

    async def look(seat):
        await seat.key("l")  # whichever of them is discovered first
        await seat.sees("  2  /other")
        await seat.sees("  1  /desk")
        await seat.key("2")
        await seat.sees("13 N ")
        await seat.sees("2 drills, l lists them")
        await seat.key("l")
        await seat.sees("  1  /desk")
        await seat.key("1")
        await seat.sees("/desk   paused")

    seated(None, look)


def test_in_a_real_terminal_it_shows_the_drill_and_q_restores_the_terminal(client):
    client.begin()
    command = ("rpud", "watch", "--terminal", "--namespace", "/desk")
    with PseudoTerminal(*command, TERM="xterm-256color", NO_COLOR="1") as terminal:
        terminal.until(lambda: "/desk   paused" in terminal.text)
        terminal.until(lambda: "10 N " in terminal.text)
        assert terminal.modes[3] != terminal.modes_before[3]  # raw: no echo
        terminal.type("q")
        assert terminal.wait() == 0
        assert terminal.modes == terminal.modes_before
        assert b"\x1b[?1049l" in terminal.drawn  # the screen of the shell
        assert terminal.drawn.rindex(b"\x1b[?25h") > terminal.drawn.rindex(b"\x1b[?25l")
        assert b"\x1b[38;" not in terminal.drawn  # no colour
        assert b"\x1b[31" not in terminal.drawn


def test_sigterm_restores_the_terminal_too(paused):
    command = ("rpud", "watch", "--terminal", "--namespace", "/desk")
    with PseudoTerminal(*command, TERM="vt100") as terminal:
        terminal.until(lambda: "/desk   paused" in terminal.text)
        assert "▁" not in terminal.text
        os.kill(terminal.pid, 15)
        assert terminal.wait() == 0
        assert terminal.modes == terminal.modes_before


def test_where_nothing_can_be_drawn_one_line_says_what_to_use_instead():
    done = subprocess.run(
        ["rpud", "watch", "--terminal"], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("rpud watch: --terminal needs a terminal")
    assert "rpud echo status" in line
    with PseudoTerminal("rpud", "watch", "--terminal", TERM="dumb") as terminal:
        assert terminal.wait() == 2
        assert terminal.text.count("\n") == 1
        assert "TERM = 'dumb'" in terminal.text


def test_without_textual_it_names_the_extra():
    script = """
import sys
sys.modules["textual"] = None
from rpud_sim.cli.main import main
main(["watch", "--terminal"])
"""
    with PseudoTerminal(sys.executable, "-c", script, TERM="xterm") as terminal:
        assert terminal.wait() == 1
        expected = "rpud watch: needs textual: pip install 'rpud_sim[terminal]'"
        assert terminal.text.strip() == expected
