"""The screen of a bag in a real browser: playhead, playing, and zooming down to one contact."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from browser_pages import PHONE, SCHEMES, WIDE
from browser_screens import drag, of_screen, text_has, text_is, until_screen, view_of
from recorded_bags import FAULTS, rewritten, without_waveform
from sample_bags import write_offline_bag
from support import Process

import rpud_sim.bag
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import read_scenario

pytestmark = pytest.mark.extended

HOSTILE = "/rpud/<img src=x onerror=alert(1)>"
DURATION = 10.5  # longer than what is drawn from single messages at once


@dataclass(frozen=True)
class Drilled:
    """Bag on a server, and the impacts in it."""

    path: Path
    url: str
    impacts: dict[str, np.ndarray]


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    """Drill with two faults, and a topic whose name is HTML."""
    folder = tmp_path_factory.mktemp("screen")
    (folder / "faults.yaml").write_text(FAULTS, encoding="utf-8")
    scenario = read_scenario(folder / "faults.yaml")
    write_offline_bag(folder / "whole", preset("drilling"), DURATION, scenario=scenario)
    topics = without_waveform(folder / "whole")
    copies = {"/rpud/reacting_force": HOSTILE}
    path = rewritten(folder / "whole", folder / "drilled", 1 << 18, topics, copies)
    with rpud_sim.bag.open(path) as reader:
        impacts = reader.arrays("/rpud/contact_force", 2 * 10**9, 10**8)
    with Process("rpud", "watch", path, "--port", "0") as server:
        yield Drilled(path, server.wait_for_line(r"bag .*: (http://\S+)")[1], impacts)


@pytest.fixture
def recorded(page_of, drilled):
    def open_screen(**options):
        page = page_of(drilled.url, **options)
        page.until("document.documentElement.dataset.connection === 'open'")
        until_screen(page, "screen.seen.read === 1 && screen.seen.view && screen.clock.block")
        return page

    return open_screen


def put_playhead(page, time):
    of_screen(page, f"screen.playhead.seek({time})")
    until_screen(page, f"Math.abs(screen.playhead.time - {time}) < 1e-9")


def test_the_playhead_begins_at_the_start(recorded, drilled):
    page = recorded()
    assert of_screen(page, "screen.playhead.time") == 0.0
    until_screen(page, "screen.clock.block.time < 0.01")  # the first motion, and not the last
    page.tab.keyboard.press("n")
    text_has(page, "#found", "^impact at 0.0")
    text_is(page, "#doing", "drilling")
    text_has(page, "#in-force", r"weight on bit 8.N . drive 100.V, 16.kHz . in the rock")


def test_a_zoom_into_a_contact_shows_its_peak_force(recorded, drilled):
    impacts = drilled.impacts
    times = impacts["header.stamp"] / 1e9
    following = int(np.flatnonzero(times > 2.02)[0])
    page = recorded()
    put_playhead(page, 2.02)
    page.tab.keyboard.press("n")
    text_has(page, "#found", f"^impact at {times[following]:.9f} s")
    page.tab.get_by_role("button", name="Zoom to this contact").click()
    until_screen(page, "screen.seen.view.detail === 'waveform'")
    start, end = view_of(page)
    contact = impacts["contact_duration"][following]
    assert end - start == pytest.approx(2 * contact, rel=0.01)
    until_screen(page, f"Math.abs(screen.seen.view.start - {start}) < 1e-9")
    peak = of_screen(page, "Math.max(...screen.seen.view.layers.contact_force.mean)")
    assert peak == pytest.approx(impacts["peak_force"][following], rel=1e-6)
    assert of_screen(page, "screen.seen.view.layers.contact_force.t.length") > 200
    box = page.tab.locator("[data-plot=peak_force] .u-over").bounding_box()
    page.tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 5)
    text_has(page, "[data-plot=peak_force]", r"contact force\d.*kN")
    page.tab.locator("[data-plot=motion] canvas").wait_for()  # exact as well
    page.tab.get_by_role("button", name="previous impact").click()
    text_has(page, "#found", f"^impact at {times[following - 1]:.9f} s")
    # The mean of a second lasts through the contact; the time is as exact, and covers nothing.
    page.tab.locator("[data-plot=more] select").select_option(label="power, mean of a second")
    until_screen(page, "screen.plots.plots.at(-1).plot.data[1].length > 1")
    assert of_screen(page, "screen.plots.plots.at(-1).plot.data[0].at(-1) >= screen.range.end")
    time, button = (page.tab.locator(each).bounding_box() for each in ("#time", "#previous"))
    assert time["x"] + time["width"] <= button["x"]
    page.keep("contact", whole=False)
    page.assert_quiet()


def test_faults_and_commands_are_marked_and_playing_moves_the_playhead(recorded):
    page = recorded()
    assert of_screen(page, "screen.seen.faults.map((each) => each.onset)") == [0.4, 1.0]
    page.tab.get_by_text("log of commands", exact=True).click()
    text_has(page, "#details", "bias on reacting force 5 N")
    page.tab.get_by_text("log of commands", exact=True).click()

    of_screen(page, "screen.zoom(0.9, 1.5)")
    for time in (1.2, 1.4):  # the section shows the playhead's motion, also one that was held
        of_screen(page, "screen.clock.still(0)")
        put_playhead(page, time)
        until_screen(page, f"Math.abs(screen.clock.block.time + screen.clock.end - {time}) < 1e-3")
    box = page.tab.locator("[data-plot=load] .u-over").bounding_box()
    page.tab.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 5)
    text_has(page, "#cursor", r"^1\.\d+.s . restitution loss$")
    section = of_screen(page, "screen.clock.block.time")
    page.tab.click("#play")
    until_screen(page, "screen.playhead.time > 1.6 && screen.range.start > 1.2")
    until_screen(page, f"screen.clock.block.time !== {section}")
    page.tab.click("#play")
    stopped = of_screen(page, "screen.playhead.time")
    page.settle()
    assert of_screen(page, "screen.playhead.time") == stopped
    page.tab.select_option("#speed", "20")
    page.tab.click("#play")
    until_screen(page, "!screen.playhead.playing")  # at the end it stops by itself
    assert of_screen(page, "screen.playhead.time === screen.extent[1]")
    page.tab.evaluate("document.activeElement.blur()")
    page.tab.keyboard.press("n")
    text_has(page, "#found", "there is no further impact")
    page.assert_quiet()


def test_the_keyboard_the_mouse_and_the_wheel_change_the_view(recorded):
    page = recorded()
    whole = view_of(page)
    drag(page, "[data-plot=peak_force]", 0.4, 0.6)
    found = view_of(page)
    assert found == pytest.approx([0.4 * whole[1], 0.6 * whole[1]], abs=0.05)
    until_screen(page, f"Math.abs(screen.seen.view.start - {found[0]}) < 0.2")
    page.tab.keyboard.press("+")
    start, end = view_of(page)
    assert end - start == pytest.approx((found[1] - found[0]) / 1.6)
    page.tab.keyboard.press("ArrowRight")
    assert view_of(page)[0] == pytest.approx(start + 0.25 * (end - start))
    page.tab.keyboard.press("-")
    page.tab.keyboard.press("ArrowLeft")
    page.tab.keyboard.press("Home")
    assert view_of(page) == whole
    drag(page, "#timeline", 0.2, 0.3)
    assert view_of(page) == pytest.approx([0.2 * whole[1], 0.3 * whole[1]], abs=0.05)
    page.tab.locator("[data-plot=load] .u-over").dblclick()
    assert view_of(page) == whole
    page.tab.locator("[data-plot=load] .u-over").hover()
    page.tab.keyboard.down("Control")
    page.tab.mouse.wheel(0, -300)
    page.tab.keyboard.up("Control")
    page.until("document.querySelector('#reach').textContent.includes('in view')")
    page.tab.locator("#timeline .u-over").click(position={"x": 200, "y": 10})
    until_screen(page, "screen.playhead.time < 3")
    page.assert_quiet()


def hover(page, plot, share):
    box = page.tab.locator(f"{plot} .u-over").bounding_box()
    page.tab.mouse.move(box["x"] + share * box["width"], box["y"] + 30)


def test_two_cursors_show_their_difference_and_a_click_on_the_legend_hides_a_line(recorded):
    page, load = recorded(), "screen.plots.plots.find(({ definition }) => definition.id === 'load')"
    page.tab.keyboard.press("?")
    page.tab.get_by_text("set or remove a second cursor").wait_for()
    page.tab.keyboard.press("Escape")
    of_screen(page, "screen.zoom(0, 10)")
    until_screen(page, "screen.seen.view.end === 10")
    hover(page, "[data-plot=load]", 0.25)
    text_has(page, "[data-plot=load] .key output", r"^[\d.]+.N \(.?[\d.]+ to [\d.]+\)$")
    page.tab.keyboard.press("m")
    until_screen(page, "Math.abs(screen.seen.mark - 2.5) < 0.05")
    hover(page, "[data-plot=load]", 0.75)
    text_has(page, "#cursor", r"^\u0394.(4\.9|5\.0)\d*.s")
    text_has(page, "[data-plot=load] .key output", r", \u0394.\u2212?[\d.]+.N$")
    page.tab.keyboard.down("Shift")
    drag(page, "[data-plot=load]", 0.75, 0.75)  # a click removes it
    page.tab.keyboard.up("Shift")
    until_screen(page, "Math.abs(screen.seen.mark - 7.5) < 0.05")
    page.tab.keyboard.press("m")
    until_screen(page, "screen.seen.mark === null")

    line = page.tab.locator("[data-plot=load] .key").first
    highest = of_screen(page, f"{load}.plot.scales.y.max")
    line.click()
    until_screen(page, f"!{load}.plot.series[1].show && {load}.plot.scales.y.max < {highest}")
    line.click()
    until_screen(page, f"{load}.plot.series[1].show && {load}.plot.scales.y.max === {highest}")

    of_screen(page, "screen.zoom(4, 6)")
    page.tab.keyboard.down("Shift")
    drag(page, "[data-plot=load]", 0.5, 0.75)
    page.tab.keyboard.up("Shift")
    assert view_of(page) == pytest.approx([3.5, 5.5], abs=0.05)
    page.assert_quiet()


def fingers(page, selector, *places):
    """Put fingers on a plot, by their shares of its width, and move them from place to place."""
    box = page.tab.locator(f"{selector} .u-over").bounding_box()
    touch = page.tab.context.new_cdp_session(page.tab)

    def send(kind, shares):
        x, y = box["x"], box["y"] + 0.5 * box["height"]
        points = [
            {"x": x + share * box["width"], "y": y, "id": n} for n, share in enumerate(shares)
        ]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    send("touchStart", places[0])
    for shares in places[1:]:
        send("touchMove", shares)
    send("touchEnd", [])


def test_fingers_move_and_stretch_the_view(recorded):
    page = recorded(width=PHONE, has_touch=True)
    of_screen(page, "screen.zoom(4, 6)")
    page.tab.locator("[data-plot=load]").scroll_into_view_if_needed()
    fingers(page, "[data-plot=load]", [0.5], [0.6], [0.75])
    assert view_of(page) == pytest.approx([3.5, 5.5], abs=0.05)
    of_screen(page, "screen.zoom(4, 6)")
    fingers(page, "[data-plot=load]", [0.4, 0.6], [0.35, 0.65], [0.3, 0.7])
    assert view_of(page) == pytest.approx([4.5, 5.5], abs=0.05)
    page.assert_quiet()


def test_a_view_is_kept_in_the_address_and_saved_as_table_and_picture(recorded, drilled):
    page = recorded()
    page.tab.locator("[data-plot=more] select").select_option(label="positions")
    of_screen(page, "screen.zoom(2, 2.5)")
    page.until("location.hash.includes('view=')")
    page.tab.reload()
    until_screen(page, "screen.seen.view.start > 1.9 && screen.seen.view.layers.nodal_plane")
    assert view_of(page) == [2.0, 2.5]
    with page.tab.expect_download() as download:
        page.tab.click("#csv")
    head, *rows = download.value.path().read_text().splitlines()
    assert head.startswith('time [s],"peak force [kN]"')
    cells = np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows])
    times = drilled.impacts["header.stamp"] / 1e9
    within = (times >= 2.0) & (times <= 2.5)
    assert (cells[:, 0] >= 2.0).all()
    assert (cells[:, 0] <= 2.5).all()
    greatest = np.nanmax(cells[:, 1])
    assert greatest == pytest.approx(drilled.impacts["peak_force"][within].max() / 1e3, rel=1e-5)
    with page.tab.expect_download() as download:
        page.tab.click("#png")
    assert download.value.path().read_bytes().startswith(b"\x89PNG")
    assert download.value.suggested_filename == "rpud_2.0_2.5.png"


def test_axes_and_factors_say_what_they_are(recorded):
    page, axis = recorded(), "screen.plots.plots.at(-1).plot.axes[0]"
    text_has(page, "#strip-of", r"^peak force, 0 to [\d.]+ kN$")
    text_has(page, "#section", r"slow motion 1000\u00d7.*motion drawn \d+\u00d7")
    text_has(page, "#section [data-part=step]", r"^indentation \d+ \u00b5m$")
    text_has(page, "#section [data-part=drawn]", r"^drawn \d+\u00d7$")
    put_playhead(page, 3)
    text_has(page, "#numbers", "[\\d.]+ to [\\d.]+\nmin\u2013max, 1 s")
    until_screen(page, f"{axis}._values.includes('2 s')")
    of_screen(page, "screen.zoom(2, 2.02)")
    until_screen(page, f"{axis}._values.some((each) => each.endsWith('+5 ms'))")
    long = "{ bbox: { left: 0, width: 900 }, valToPos: () => 99 }, [3600, 7200, 10800], 0, 0, 3600"
    assert of_screen(page, f"{axis}.values({long})") == ["01:00:00", "02:00:00", "03:00:00"]


def test_all_values_have_units_and_changed_parameters_come_first(recorded):
    page = recorded()
    page.tab.get_by_text("all values", exact=True).click()
    values = page.tab.locator("#details")
    # A folded part is filled by an event after the click.
    values.get_by_role("row", name="weight on bit 8 N").first.wait_for()
    parameters = values.get_by_role("region", name="parameters").locator("tbody tr")
    assert (
        "default" in values.get_by_role("region", name="parameters").locator("thead").inner_text()
    )
    defaults = [row.split("\t")[2] for row in parameters.all_inner_texts()]
    assert sorted(defaults, key=lambda default: not default) == defaults
    # Beside the section, above the plots that share a time axis.
    motion, plots, section = (
        page.tab.locator(f"#{name}").bounding_box() for name in ("motion", "plots", "section")
    )
    assert motion["y"] + motion["height"] <= plots["y"] + 1
    assert motion["y"] < section["y"] + section["height"]


def test_the_reader_chooses_a_signal_and_a_hostile_name_stays_text(recorded):
    page = recorded()
    choice = page.tab.locator("[data-plot=more] select")
    names = choice.locator("option").all_inner_texts()
    name = next(name for name in names if HOSTILE.removeprefix("/rpud/") in name)
    choice.select_option(label=name)
    of_screen(page, "screen.zoom(3, 4)")
    value = choice.input_value()
    until_screen(page, f"screen.seen.view.layers[{value!r}] && screen.seen.view.start > 2.9")
    chosen, force = (
        of_screen(page, f"Array.from(screen.seen.view.layers[{name!r}].mean)")
        for name in (value, "reacting_force")
    )
    assert chosen == force
    assert page.tab.locator("img").count() == 0
    page.assert_quiet()


@pytest.mark.parametrize("width", [PHONE, WIDE])
def test_it_can_be_read_by_everybody(recorded, width):
    page = recorded(width=width)
    page.tab.keyboard.press("n")
    text_has(page, "#found", "^impact at")
    for scheme in SCHEMES:
        page.show(scheme)
        page.settle()
        page.keep(f"bag_{width}_{scheme}")
        page.check()
