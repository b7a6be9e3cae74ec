"""The screen of a running drill in a real browser: what it shows, does and survives."""

import os
import re
import signal
from urllib.parse import quote

import pytest
from browser_pages import PHONE
from browser_screens import (
    of_screen,
    opened,
    served,
    text_has,
    text_is,
    until_screen,
    view_of,
)
from drill_client import start_drill
from support import PATIENCE, Process

from rpud_sim.ros.client import DrillClient

pytestmark = pytest.mark.extended

NAMESPACE = "/live_screen"


@pytest.fixture(scope="module")
def drill():
    with start_drill(NAMESPACE, rock_model="specific_energy") as running:
        yield running


@pytest.fixture(scope="module")
def server(drill):
    with served(NAMESPACE) as address:
        yield address


@pytest.fixture(scope="module")
def client(drill):
    with DrillClient(NAMESPACE, node_name="test_client", patience=PATIENCE) as found:
        yield found


@pytest.fixture
def live(server, client, page_of):
    """Screen of a drill that plays as at its start."""
    page = opened(page_of, server, NAMESPACE)
    run = of_screen(page, "screen.seen.run")
    client.reset("all")
    client.play()
    until_screen(page, f"screen.seen.run > {run} && screen.seen.status?.state === 'running'")
    return page


def click(page, name, *, inside="body"):
    page.tab.locator(inside).get_by_role("button", name=name, exact=True).click()


def pressed_is(live, name):
    buttons = "[...document.querySelectorAll('.switch button')]"
    live.until(f"{buttons}.find((e) => e.textContent === '{name}').ariaPressed === 'true'")


def places_of_controls(live):
    return live.tab.evaluate(
        "[...document.querySelectorAll('header button, header input')]"
        ".map((e) => e.getBoundingClientRect()).map(({ left, top, width }) => [left, top, width])"
    )


def until_status(client, **fields):
    client.until(
        lambda: all(getattr(client.status, name) == value for name, value in fields.items())
    )


def test_numbers_on_the_screen_are_those_of_the_drill(live, client):
    client.press(23.5)
    client.pause()
    client.step(1.5)
    client.take()
    status = client.status
    text_is(live, "#doing", "paused")
    live.until("document.querySelector('#weight').value === '23.5'")
    for name in ("impacts", "weight_on_bit", "drive_voltage", "depth"):
        until_screen(live, f"screen.seen.status.{name} === {getattr(status, name)}")
    text_is(live, "#driven", f"set {status.drive_voltage:g}\xa0V, 16\xa0kHz")
    text_is(live, "#weight-set", "set 23.5\xa0N")
    text_has(live, "#weight-actual", r"^reacting \d[\d.]{3}.N$")
    text_has(live, "#time", r"^\d+\.\d{3}.s$")  # a short step is seen

    impacts = client.listen("contact_force")
    while not impacts:  # until it is heard
        client.step(0.1)
        client.take()
    now = of_screen(live, "screen.seen.now")
    client.step(1.2)
    until_screen(live, f"screen.seen.now > {now} + 1.1")
    rate = "document.querySelector('[data-number=impact_rate]')"

    def peaks():
        """Return peak forces of the last second."""
        ends = [each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in impacts]
        return [
            impact.peak_force
            for impact, end in zip(impacts, ends, strict=True)
            if end > client.time - 1
        ]

    client.until(lambda: abs(len(peaks()) - int(live.tab.evaluate(f"{rate}.textContent"))) < 4)
    exact = "Number(document.querySelector('[data-number=peak_force]').dataset.exact)"
    live.until(f"Math.abs({exact} / {sum(peaks()) / len(peaks())} - 1) < 0.01")


def test_section_and_plots_follow_the_drill(live):
    before = view_of(live)
    until_screen(live, "screen.seen.view.layers.peak_force?.t.length > 20")
    until_screen(live, f"screen.range.end > {before[1]} + 0.5")
    until_screen(live, "screen.seen.timeline.t.length > 2")
    until_screen(live, "screen.clock.block !== null")
    place = of_screen(live, "screen.clock.place")
    until_screen(live, f"screen.clock.place !== {place}")
    live.tab.locator("figure[data-plot=peak_force] .u-over").hover()
    text_has(live, "figure[data-plot=peak_force] .key output", "kN")
    text_has(live, "figure[data-plot=load] .key output", "N")
    text_has(live, "#cursor", r"^\d+\.\d+.s")
    of_screen(live, "screen.zoom(0, 0.5)")
    assert not of_screen(live, "screen.follows")
    click(live, "back to live")
    until_screen(live, "screen.follows && screen.seen.view.end > 0.5")
    assert live.tab.locator("#back").is_disabled()


def test_each_control_does_what_it_says(live, client):
    tab = live.tab
    tab.fill("#weight", "31")
    click(live, "Apply", inside="#press")
    until_status(client, weight_on_bit=31.0)
    until_screen(live, "screen.seen.log.some((each) => each.text.includes('31'))")
    click(live, "Set\N{HORIZONTAL ELLIPSIS}")
    tab.get_by_label("voltage [V]").fill("80")
    click(live, "Apply", inside="#drive-pop")
    until_status(client, drive_voltage=80.0, drive_enabled=True)
    places = places_of_controls(live)
    click(live, "Off")
    until_status(client, drive_enabled=False)
    pressed_is(live, "Off")
    click(live, "Retract")
    until_status(client, regime="free")
    text_is(live, "#doing", "off")
    pressed_is(live, "Retract")
    click(live, "Engage")
    until_status(client, regime="drilling")
    click(live, "Pause")
    until_status(client, state="paused")
    pressed_is(live, "Pause")
    assert places_of_controls(live) == places  # whatever the drill does
    before = client.time
    tab.get_by_label("step [s]").fill("0.25")
    click(live, "Step")
    client.until(lambda: client.time >= before + 0.25)
    done = "screen.seen.outcomes.some(({ name, state }) => name === 'step' && state === 'done')"
    until_screen(live, done)
    pressed_is(live, "Pause")
    tab.evaluate("document.activeElement.blur()")
    tab.keyboard.press(" ")  # others use the drill, too: no key plays or pauses it
    click(live, "Play")
    until_status(client, state="running")
    click(live, "Inject\N{HORIZONTAL ELLIPSIS}")
    tab.locator("#kinds").select_option("bias")
    tab.locator("#channels").select_option("reacting_force")
    text_is(live, "#kind-says", "a constant offset on the main quantity")
    text_is(live, "#meaning", "offset [N]")
    assert tab.locator("#magnitude").get_attribute("placeholder") == "1"
    tab.locator("#kinds").select_option("free_mass_jammed")  # it has neither
    assert not tab.locator("#magnitude").is_visible()
    assert not tab.locator("#channels").is_visible()
    tab.locator("#kinds").select_option("bias")
    tab.locator("#channels").select_option("reacting_force")
    tab.locator("#magnitude").fill("2.5")
    click(live, "Inject", inside="#fault-pop")
    client.until(lambda: client.faults and client.faults[-1].active)
    fault = client.faults[-1]
    assert (fault.kind, fault.channel, fault.magnitude) == ("bias", "reacting_force", 2.5)
    live.until("document.querySelector('#alarms li')")
    text_has(live, "#alarms li", r"^bias on reacting force .*2\.5 Nfor \d+ s, since [\d.]+ s")
    text_is(live, "#count", "1 active")
    click(live, f"clear fault {fault.number}")
    client.until(lambda: not client.faults[-1].active)
    text_is(live, "#count", "0 active")
    assert tab.locator("#alarms li").count() == 0
    assert places_of_controls(live) == places
    run = of_screen(live, "screen.seen.run")
    tab.locator("[popovertarget=reset-pop]").click()
    click(live, "Reset", inside="#reset-pop")
    until_status(client, weight_on_bit=8.0)
    until_screen(live, f"screen.seen.run > {run} && screen.seen.now > 0")
    assert of_screen(live, "screen.seen.faults.length") == 0
    live.assert_quiet()


def test_a_refusal_stands_beside_its_control_and_a_jam_is_called_so(live):
    live.tab.fill("#weight", "-5")
    click(live, "Apply", inside="#press")
    text_has(live, "[data-of=press] .outcome", "-5 N is")
    box = live.tab.locator("[data-of=press] .outcome").bounding_box()
    control = live.tab.locator("[data-of=press]").bounding_box()
    assert abs(box["x"] - control["x"]) < 5
    assert 0 < box["y"] - control["y"] < 60
    covered = live.tab.locator("main").bounding_box()["y"]
    assert box["y"] + box["height"] <= covered
    live.tab.fill("#weight", "9")  # the reason goes with its cause
    text_is(live, "[data-of=press] .outcome", "not applied yet")
    live.until("document.querySelector('#weight').classList.contains('pending')")
    click(live, "Apply", inside="#press")
    text_is(live, "[data-of=press] .outcome", "")
    live.until("!document.querySelector('#weight').classList.contains('pending')")

    click(live, "Inject\N{HORIZONTAL ELLIPSIS}")
    live.tab.locator("#kinds").select_option("free_mass_jammed")
    until_screen(live, "screen.clock.block")
    block = of_screen(live, "screen.clock.block.time")
    of_screen(live, "screen.clock.speed = 1e-3")  # so slow that it never ends
    click(live, "Inject", inside="#fault-pop")
    text_is(live, "#doing", "jammed")
    live.until("document.title.startsWith('jammed')")
    until_screen(live, f"screen.clock.block.time > {block}")
    text_is(live, "[data-number=impact_rate]", "0")
    until_screen(live, "screen.clock.block.impacts.length === 0")
    click(live, "clear fault 1")
    text_is(live, "#doing", "drilling")
    until_screen(live, "screen.clock.block.impacts.length > 0")
    live.tab.get_by_text("log of commands", exact=True).click()
    text_has(live, "#details", "free mass jammed")


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (1024, "light"), (PHONE, "dark")])
def test_the_screen_is_accessible_and_asks_nothing_of_other_machines(
    live, server, page_of, width, scheme
):
    page = opened(page_of, server, NAMESPACE, width=width, scheme=scheme)
    until_screen(page, "screen.clock.block !== null && screen.seen.timeline")
    for summary in page.tab.locator("#details summary").all():
        if summary.is_visible():
            summary.click()
    page.keep(f"live_{width}_{scheme}")
    page.check()
    if width == PHONE:  # section, numbers and peak force are on two screens
        bottom = "document.querySelector('[data-plot=peak_force]').getBoundingClientRect().bottom"
        assert page.tab.evaluate(f"{bottom} + scrollY") < 2 * 812


@pytest.mark.parametrize("namespace", ["<script>alert(1)</script>", "/a b", "/'\"><img src=x>"])
def test_a_hostile_namespace_stays_text(server, page_of, namespace):
    page = page_of(f"{server}/screen?namespace={quote(namespace)}")
    page.until("document.querySelector('#banner').textContent !== ''")
    assert page.tab.locator("img").count() == 0
    page.assert_quiet()


@pytest.mark.parametrize("stopped", ["server", "drill"])
def test_what_stands_still_does_not_look_alive(drill, client, page_of, stopped):
    with Process("rpud", "watch", "--port", "0", "--namespace", NAMESPACE) as running:
        page = opened(page_of, running.wait_for_line(r"(http://[^/]+)/")[1], NAMESPACE)
        client.reset("all")
        client.play()
        text_is(page, "#doing", "drilling")
        process = running if stopped == "server" else drill
        os.kill(process.pid, signal.SIGSTOP)
        try:
            text_has(page, "#doing", "not connected")
            text_has(page, "#banner", "does not answer")
            text_has(page, "#age", "^data [2-9].* s old$")
            assert page.tab.evaluate("document.documentElement.dataset.stale") == "true"
            page.tab.fill("#weight", "33")
            click(page, "Apply", inside="#press")
            text_is(page, "[data-of=press] .outcome", "not connected")
        finally:
            os.kill(process.pid, signal.SIGCONT)
        text_is(page, "#doing", "drilling")
        text_is(page, "#banner", "")
        client.until(lambda: client.status.weight_on_bit == 8.0)
        page.tab.fill("#weight", "32")
        click(page, "Apply", inside="#press")
        text_is(page, "[data-of=press] .outcome", "done")
        text_is(page, "[data-of=press] .outcome", "")
        client.until(lambda: client.status.weight_on_bit == 32.0)


def test_the_server_comes_back_and_the_screen_goes_on(drill, page_of):
    with served(NAMESPACE) as base:
        page = opened(page_of, base, NAMESPACE)
    text_has(page, "#banner", "The server has gone")
    of_screen(page, "delete screen.seen.now")
    port = re.search(r":(\d+)$", base)[1]
    with Process("rpud", "watch", "--port", port, "--namespace", NAMESPACE) as running:
        running.wait_for_line("http://")
        until_screen(page, "screen.seen.now > 0")
        text_is(page, "#banner", "")
