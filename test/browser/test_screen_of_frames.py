"""The screen in a real browser, of frames that a test writes one by one."""

from collections import deque

import numpy as np
import pytest
from browser_screens import of_screen, text_has, text_is, until_screen
from screen_client import serving
from support import until

from rpud_sim.viewer.frames import Store
from rpud_sim.viewer.history import MOTION

pytestmark = pytest.mark.extended


class Scripted(Store):
    """Running drill whose next frames are in ``frames``."""

    mode = "live"

    def __init__(self):
        self.frames, self.client, self.asked = deque(), None, []

    def request(self, client, name, content):
        self.asked.append((content["name"], content["arguments"]))

    def frame(self, client):
        self.client = client
        return self.frames.popleft() if self.frames else None


@pytest.fixture
def store():
    return Scripted()


@pytest.fixture
def page(store, page_of):
    store.frames.append({"run": 1, "drill": "/d", "now": 30.0, "extent": [0.0, 30.0]})
    with serving(store) as server:
        page = page_of(server.url("/screen"))
        until_screen(page, "screen.seen.now")
        yield page
        page.assert_quiet()
        page.close()


def test_another_run_is_followed_from_its_beginning(store, page):
    of_screen(page, "screen.zoom(10, 20)")
    page.until("document.querySelector('#reach').textContent !== ''")
    until(lambda: store.client.view.follow is None)
    store.frames.append({"run": 2, "drill": "/d", "now": 1.0, "extent": [0.0, 1.0]})
    until(lambda: store.client.view.follow == 20.0)
    assert page.tab.text_content("#reach") == ""


def block(time):
    arrays = dict.fromkeys(MOTION, np.zeros(200, np.float32))
    return {"section": {"time": time, "period": 1e-4, "impacts": [], **arrays}}


def test_a_pause_shows_the_block_that_waited(store, page):
    of_screen(page, "screen.clock.speed = 1e-3")  # so slow that no block ends
    store.frames += [{"status": {"state": "running"}}, block(1.0), block(2.0)]
    until_screen(page, "screen.clock.next")
    store.frames.append({"status": {"state": "paused"}})
    until_screen(page, "screen.clock.block.time === 2 && screen.clock.resting")


def test_a_fault_shows_the_first_block_of_after_it(store, page):
    of_screen(page, "screen.clock.speed = 1e-3")
    fault = {"number": 1, "kind": "free_mass_jammed", "channel": "", "onset": 30.0, "active": True}
    store.frames += [{"status": {"state": "running"}, **block(29.0)}, {"faults": [fault]}]
    store.frames.append(block(29.9))  # it was recorded before the fault
    until_screen(page, "screen.clock.block.time === 29.9")
    until(lambda: store.client.section)  # a newer one is asked for
    store.frames.append(block(30.1))
    until_screen(page, "screen.clock.block.time === 30.1")
    store.frames.append(block(30.2))  # it waits for its turn
    until_screen(page, "screen.clock.next.time === 30.2")


RUNNING = {"state": "running", "regime": "drilling", "weight_on_bit": 8.0, "drive_enabled": True}


def show(store, page, **fields):
    """Show a frame, and wait until it is drawn."""
    store.frames.append({**fields, "read": (mark := np.random.default_rng().random())})
    until_screen(page, f"screen.seen.read === {mark}")


def test_a_field_that_a_reader_edits_is_never_written_to(store, page):
    """Another client presses while somebody types: what is sent is what was typed."""
    field = page.tab.locator("#weight")
    show(store, page, status=RUNNING)
    assert field.input_value() == "8"
    show(store, page, status={**RUNNING, "weight_on_bit": 9.0})
    assert field.input_value() == "9"  # nobody edits it
    field.click()
    field.press("Control+a")
    field.press("3")
    for force in (11.0, 12.0):
        show(store, page, status={**RUNNING, "weight_on_bit": force})
        text_is(page, "#weight-set", f"set {force:g}\N{NO-BREAK SPACE}N")
        text_is(page, "[data-of=press] .outcome", "not applied yet")
    field.press("5")
    assert field.input_value() == "35"
    field.evaluate("(each) => each.blur()")  # it still differs from what was in force
    show(store, page, status={**RUNNING, "weight_on_bit": 13.0})
    assert field.input_value() == "35"
    field.press("Enter")
    until(lambda: store.asked)
    assert store.asked == [("press", {"force": 35})]
    show(store, page, status={**RUNNING, "weight_on_bit": 35.0})
    field.evaluate("(each) => each.blur()")
    show(store, page, status={**RUNNING, "weight_on_bit": 14.0})
    assert field.input_value() == "14"  # the edit is over
    field.fill("99")
    field.press("Escape")  # and it can be given up
    assert field.input_value() == "14"


RATE = {"impact_rate": {"mean": 400.0, "least": 1.0, "greatest": 2.0, "spark": []}}
LOST = {"peak_force": {"mean": None, "least": None, "greatest": None, "spark": [], "lost": True}}
JAM = {"number": 1, "kind": "free_mass_jammed", "channel": "", "onset": 29.0, "end": None}
JAM |= {"active": True, "size": ""}


@pytest.mark.parametrize(
    ("status", "others", "word", "why"),
    [
        ({"penetration_rate": 2e-5}, {}, "drilling", r"^1\.20.mm/min$"),
        ({"penetration_rate": None}, {}, "drilling", "^$"),  # it has no rock
        ({"penetration_rate": 0.0}, {}, "no progress", r"^0.mm/min$"),
        ({"penetration_rate": 0.0}, {"values": {"mount": {"in_contact": False}}}, "no contact", ""),
        ({"penetration_rate": 0.0}, {"faults": [JAM]}, "jammed", "free mass jammed since 29"),
        ({"drive_enabled": False}, {}, "off", "the drive is off"),
        ({}, {"stepping": [23.4, 60.0]}, "stepping", "^23 of 60 s$"),
        (
            {"commands_lost": True},
            {"parameters": [["command_timeout", "0.5 s", "0 s"]]},
            *("commands lost", "none came for 0.5 s"),
        ),
        ({}, {"numbers": LOST}, "messages lost", "peak force"),
        ({"state": "paused"}, {}, "paused", "^$"),
        ({}, {"silent": 5}, "not connected", "^$"),
    ],
)
def test_the_word_says_what_the_drill_does(store, page, status, others, word, why):
    show(store, page, **{"status": {**RUNNING, **status}, "numbers": RATE, **others})
    text_is(page, "#doing", word)
    text_has(page, "#why", why)
    page.until(f"document.title.startsWith({word!r})")
    good = page.tab.get_attribute("#state", "data-tone") == "good"
    assert good == (word == "drilling")
    contact = others.get("values", {}).get("mount", {}).get("in_contact", True)
    text_is(page, "#place", "in the rock" if contact else "not in the rock")
    assert page.tab.is_visible("#section .air") == (not contact)


@pytest.mark.parametrize("force", [23.96, 24.0, 24.04])
def test_measured_values_keep_their_digits(store, page, force):
    """A value that changes each frame does not jump in width when its last digit is zero."""
    reacting = {"mean": force, "least": 0.0, "greatest": 40.0, "spark": []}
    show(store, page, status=RUNNING, numbers={**RATE, "reacting_force": reacting})
    text_is(page, "#weight-actual", "reacting 24.0\N{NO-BREAK SPACE}N")


def test_nothing_moves_when_alarms_come(store, page):
    show(store, page, status=RUNNING, numbers=RATE)
    place = page.tab.locator("#numbers").bounding_box()
    faults = [{**JAM, "number": number, "kind": "bias"} for number in range(5)]
    show(store, page, faults=faults, notice="Its runs are not known. " * 20)
    assert page.tab.locator("#alarms li").count() == 5
    assert page.tab.locator("#numbers").bounding_box() == place


def test_an_alarm_has_its_whole_name_in_a_narrow_window(store, page):
    page.tab.set_viewport_size({"width": 840, "height": 640})
    show(store, page, status=RUNNING, numbers=RATE, faults=[JAM])
    name = page.tab.locator("#alarms li > :first-child")
    assert name.evaluate("(each) => each.scrollWidth <= each.clientWidth")


PLOT = {
    "id": "peak_force",
    "title": "peak force",
    "choices": [
        {
            "id": "",
            "title": "peak force",
            "layers": [{"quantity": "peak_force", "label": "peak force", "kind": "band"}],
        }
    ],
}
TIMES = np.arange(20.0, 30.0, 0.1)
BAND = {"t": TIMES, "mean": TIMES * 100, "low": TIMES * 90, "high": TIMES * 110, "band": "5-95 %"}


def view(**fields):
    layers = {"peak_force": {**BAND, **fields}}
    return {
        "view": {"start": 10.0, "end": 30.0, "detail": "overview", "band": "", "layers": layers}
    }


def pixels(page, time):
    """Return the colours of the upper half of the first plot at a time."""
    return of_screen(
        page,
        "(({ ctx, bbox, valToPos }, x) => Array.from(ctx.getImageData("
        f"Math.round(valToPos({time}, 'x', true)), bbox.top, 8, bbox.height / 2).data))"
        "(screen.plots.plots[0].plot)",
    )


def test_missing_messages_are_hatched_and_the_tile_says_so(store, page):
    show(store, page, status=RUNNING, plots=[PLOT], numbers=LOST, **view())
    text_is(page, "[data-number=peak_force]", "\N{EN DASH}")
    text_has(page, "#numbers", "messages lost")
    before = pixels(page, 13.0)
    show(store, page, **view(holes=[[12.0, 14.0]]))
    assert pixels(page, 13.0) != before


def test_garbage_reads_garbage_in_tile_plot_and_motion(store, page):
    some = {"mean": None, "least": None, "greatest": None, "spark": [], "garbage": 3}
    wrong = {"t": np.array([25.0]), "count": 1}
    drawn = []
    of_screen(
        page,
        "(CanvasRenderingContext2D.prototype.fillText = new Proxy("
        "CanvasRenderingContext2D.prototype.fillText, { apply: (target, self, given) => {"
        " (window.written ??= []).push(given[0]); return target.apply(self, given); } }), 0)",
    )
    struck = block(29.9)
    struck["section"]["impacts"] = [[0.01, 5.622377492818663e174, 2e-5]]
    shown = {"plots": [PLOT], "numbers": {"peak_force": some}}
    show(store, page, status=RUNNING, **shown, **view(garbage=wrong), **struck)
    text_is(page, "[data-number=peak_force]", "garbage")
    text_has(page, "#numbers", "3 garbage")
    until_screen(page, "screen.clock.block")
    page.until("window.written.includes('garbage')")
    page.until("window.written.includes('1 garbage')")
    drawn = page.tab.evaluate("window.written")
    assert not [text for text in drawn if "e+" in text or len(text) > 60]


def test_the_time_of_the_motion_stands_on_it_and_in_the_other_plots(store, page):
    of_screen(page, "screen.clock.speed = 1e-3")
    show(store, page, status=RUNNING, plots=[PLOT], **view(), **block(12.0))
    text_has(page, "#motion", r"motion, 12\.000 to 12\.020 s")
    until_screen(page, "screen.seen.motion?.[0] === 12")
    marked = pixels(page, 12.0)
    of_screen(page, "(screen.clock.block = null, screen.drawTime())")
    assert pixels(page, 12.0) != marked


def test_the_table_has_quantiles_by_name_and_commands_that_did_not_change(store, page):
    more = {"quantity": "weight_on_bit", "label": "weight on bit", "kind": "steps"}
    layers = [*PLOT["choices"][0]["layers"], more]
    plot = {**PLOT, "choices": [{**PLOT["choices"][0], "layers": layers}]}
    steps = {"weight_on_bit": {"t": np.array([0.0]), "v": np.array([8.0])}}
    show(store, page, status=RUNNING, plots=[plot], steps=steps, **view())
    of_screen(page, "screen.zoom(20, 30)")
    with page.tab.expect_download() as download:
        page.tab.click("#csv")
    head, *rows = download.value.path().read_text().splitlines()
    assert '"peak force, 5 % [kN]","peak force, 95 % [kN]","weight on bit [N]"' in head
    assert [row.split(",")[-1] for row in (rows[0], rows[-1])] == ["8", "8"]


def test_the_title_changes_in_a_hidden_tab_and_when_the_server_is_gone(store, page):
    page.tab.evaluate(
        "Object.defineProperty(document, 'hidden', { get: () => true });"
        "window.requestAnimationFrame = () => 0;"
    )
    store.frames.append({"status": {**RUNNING, "penetration_rate": 2e-5}, "numbers": RATE})
    page.until("document.title.startsWith('drilling \N{EN DASH} 1.2')")
    store.frames.append({"status": {**RUNNING, "state": "paused"}})
    page.until("document.title.startsWith('paused')")
    of_screen(page, "screen.connect(false, '')")
    page.until("document.title.startsWith('not connected')")


def test_the_depth_is_the_first_number_with_its_layer(store, page):
    layers = [
        {"from": 0.0, "to": 0.004, "name": "regolith", "colour": 0},
        {"from": 0.004, "to": None, "name": "limestone", "colour": 1},
    ]
    depth = {"mean": 0.00395, "least": 0.0039, "greatest": 0.00395, "spark": []}
    hole = {"depth": 0.00395, "tip": None, "layers": layers, "log": None}
    show(store, page, status=RUNNING, hole=hole, numbers={**RATE, "depth": depth})
    first = page.tab.locator("#numbers > div").first.inner_text().split("\n")
    assert first[0] == "depth"
    assert first[-2:] == ["in regolith", "0.05\N{NO-BREAK SPACE}mm to limestone"]


def test_the_cursor_moves_by_keyboard(store, page):
    show(store, page, status=RUNNING, plots=[PLOT], **view())
    page.tab.keyboard.press(".")
    text_has(page, "#cursor", r"^\d+\.\d+.s")
    text_has(page, "[data-plot=peak_force] .key output", "kN")
    before = of_screen(page, "screen.pointed")
    page.tab.keyboard.press(",")
    assert of_screen(page, "screen.pointed") < before
