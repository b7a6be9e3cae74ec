"""Section of the drill and zigzag of the free mass, on a page of their own, in a real Chromium."""

import base64
import json

import numpy as np
import pytest
from browser_pages import PHONE
from browser_screens import page_with_share

from rpud_sim.foundation.shown_quantities import QUANTITIES, for_browser
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.sampling import Times, sample
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.viewer.frames import encode
from rpud_sim.viewer.recorded import CHANNELS

pytestmark = pytest.mark.extended

RATE, COUNT = 60_000, 1200
PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>section</title><link rel="icon" href="data:,">
<link rel="stylesheet" href="share/vendor/uPlot.min.css">
<script src="share/vendor/uPlot.iife.min.js"></script>
<link rel="stylesheet" href="share/screen.css"><link rel="stylesheet" href="share/section.css">
<style>#section { height: 740px; } #motion { height: 220px; display: flex; flex-direction: column; }
main { max-width: 700px; }</style>
<main><h1>Drill</h1><figure id="section"></figure><figure id="motion"></figure></main>
<script type="module">
import { MotionClock } from "./share/clock.js";
import { decode } from "./share/frames.js";
import { mountMotion } from "./share/motion.js";
import { setQuantities } from "./share/quantities.js";
import { mountSection } from "./share/section.js";
const data = Uint8Array.from(atob("FRAME"), (letter) => letter.charCodeAt(0)).buffer;
const { sections, quantities } = decode(data);
setQuantities(quantities);
const clock = new MotionClock();
const section = mountSection(document.getElementById("section"), clock);
mountMotion(document.getElementById("motion"), clock);
const seen = [];
let wants = 0;
clock.onWant = () => { wants += 1; };
clock.listen((changed) => seen.push([changed, clock.block?.time ?? null, clock.place]));
const part = (name) => document.querySelector(`[data-part="${name}"]`);
const at = (name) => Number(part(name).getAttribute("transform").slice("translate(0 ".length, -1));
Object.assign(window, { clock, section, sections, seen, part, at, wants: () => wants });
</script></html>
"""
HOLE = {
    "depth": 0.018,
    "layers": [
        {"from": 0.0, "to": 0.01, "name": "regolith", "colour": 0},
        {"from": 0.01, "to": 0.03, "name": "sandstone", "colour": 1},
        {"from": 0.03, "to": None, "name": "basalt", "colour": 2},
    ],
    "log": {
        "depth": [0.005, 0.01, 0.018],
        "rate": [2e-4, 1e-4, 5e-5],
        "torque": [0.1, 0.2, 0.3],
    },
}


def section(regime, end):
    """Exact motion of the 20 ms before a time [s] of a drill."""
    block = Simulation(preset(regime), initial_phase=0.3).advance_to(round(end * SECOND))
    first = block.grid(RATE)[-1] - COUNT
    samples = sample(block.covering, Times.from_grid(first, COUNT, RATE))
    time = first / RATE
    impacts = [
        [each["seconds"] + each["fraction"] - time, each["peak_force"], each["contact_duration"]]
        for each in block.impacts
        if time <= each["seconds"] + each["fraction"] < time + COUNT / RATE
    ]
    arrays = {name: getattr(samples, field).astype(np.float32) for name, field in CHANNELS.items()}
    return {"time": time, "period": 1 / RATE, **arrays, "impacts": impacts}


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Address of a page with both, and with blocks of two drills."""
    sections = {
        "first": section("drilling", 0.5),
        "second": section("drilling", 0.8),
        "third": section("drilling", 1.1),
        "free": section("free", 0.7),
    }
    frame = encode({"sections": sections, "quantities": for_browser()})
    text = PAGE.replace("FRAME", base64.b64encode(frame).decode())
    with page_with_share(tmp_path_factory.mktemp("section"), text) as found:
        yield found


@pytest.fixture
def opened(page_of, address):
    def open_page(**options):
        page = page_of(address, **options)
        page.until("window.section !== undefined")
        return page

    return open_page


def run(page, code):
    return page.tab.evaluate(f"() => {{ {code} }}")


def hole(page, **changes):
    run(page, f"section.setHole({json.dumps({**HOLE, **changes})})")


@pytest.mark.parametrize("width", [1400, PHONE])
@pytest.mark.parametrize("name", ["first", "second", "third", "free"])
def test_bodies_touch_in_the_picture_where_they_touch_in_the_data(opened, name, width):
    page = opened(width=width)
    hole(page)
    run(page, f"clock.jump(sections.{name})")
    page.settle()
    gaps = np.array(
        run(
            page,
            f"""const block = sections.{name}, found = [];
            for (let each = 0; each < block.free_mass.length; each += 1) {{
              clock.still(each * block.period);
              const [plane, tip, mass, tool] = ["plane", "tip", "mass", "tool"].map(at);
              found.push([block.free_mass[each] - block.actuator[each], mass - tip,
                block.drill_tool[each] - block.free_mass[each], tool - mass - 34, plane]);
            }}
            return found;""",
        )
    )
    for data, picture in (gaps[:, :2].T, gaps[:, 2:4].T):
        assert len(data) == COUNT
        assert (picture[data > 0] > 0).all()
        assert (np.abs(picture[data == 0]) < 1e-9).all()
    assert gaps[:, 4].min() > 26 + 118  # the actuator stays below the load unit


def test_each_contact_has_its_picture(opened):
    page = opened()
    run(page, "clock.speed = 20; clock.jump(sections.first)")
    page.until("clock.resting")
    places = [place for _, _, place in run(page, "return seen")]
    impacts = run(page, "return sections.first.impacts")
    contacts = [time + length / 2 for time, _, length in impacts]
    assert len(contacts) > 3
    for contact in contacts:
        assert any(abs(place - contact) < 1e-9 for place in places)
    time, force, length = impacts[1]
    run(page, f"clock.still({time + length / 2})")
    assert float(run(page, "return part('flash').getAttribute('opacity')")) > 0.9
    written = page.tab.text_content("[data-part=force]").replace("\N{NO-BREAK SPACE}", " ")
    assert written == QUANTITIES["peak_force"].text(force)
    gap = run(page, "return at('tool') - at('mass') - 34")
    assert abs(gap) < 1e-9


def test_reader_moves_the_place_with_pointer_and_keys(opened):
    page = opened()
    run(page, "clock.jump(sections.first)")
    area = page.tab.locator("#motion .area")
    box = area.bounding_box()
    page.tab.mouse.move(box["x"] + 52 + 0.25 * (box["width"] - 62), box["y"] + 40)
    page.tab.mouse.down()
    assert run(page, "return clock.place / clock.end") == pytest.approx(0.25, abs=0.01)
    page.tab.mouse.move(box["x"] + 52 + 0.5 * (box["width"] - 62), box["y"] + 40)
    page.tab.mouse.up()
    assert run(page, "return [clock.held, clock.place / clock.end]") == [
        True,
        pytest.approx(0.5, abs=0.01),
    ]
    area.press("Home")
    area.press("PageDown")
    time, _, length = run(page, "return sections.first.impacts[0]")
    assert run(page, "return clock.place") == pytest.approx(time + length / 2)
    area.press("ArrowLeft")
    assert run(page, "return clock.place") == pytest.approx(time + length / 2 - 1e-4)
    assert "ms before the newest" in area.get_attribute("aria-valuetext")
    page.tab.get_by_role("button", name="play").click()
    page.until("!clock.held && clock.resting")
    run(page, "clock.speed = 0.5")
    page.tab.get_by_role("button", name="replay").click()
    page.until("clock.place > 0 && !clock.resting")


def test_reduced_motion_shows_the_newest_at_its_end_once_a_second(opened):
    """However often blocks come: of a drill they do each second or so, after each question."""
    page = opened(reduced_motion=True)
    run(page, "clock.set(sections.first)")
    page.until("clock.block === sections.first && clock.place === clock.end")
    run(
        page,
        "window.shown = []; clock.listen(() => shown.push(performance.now()));"
        "let sent = 0; const { second, third } = sections;"
        "setInterval(() => clock.set([second, third][++sent % 2]), 20)",
    )
    page.until("shown.length > 4 && wants() >= 1")
    shown = run(page, "return shown.slice(1)")  # the first is of the call of listen itself
    assert min(np.diff(shown)) > 900.0
    assert len({time for _, time, _ in run(page, "return seen")}) > 2  # none, first, and a newer
    assert all(place == 0 or place > 0.0199 for _, _, place in run(page, "return seen"))
    assert not page.tab.is_visible("#section button")


def test_hole_grows_through_its_layers_to_scale(opened):
    page = opened()
    run(page, "clock.jump(sections.first, true)")
    heights = []
    for depth in (0.012, 0.018):
        hole(page, depth=depth)
        for name in ("regolith", "rate", "torque"):
            assert name in page.tab.inner_html("#section")
        heights.append(run(page, "return at('bit') + 400 - 506"))
        assert page.tab.text_content("#section text.now >> nth=-1") == f"{depth * 1e3:g}"
    scale = run(
        page,
        "const rects = document.querySelectorAll('[data-part=ground] rect');"
        "return rects[0].getBBox().height / 0.01",
    )
    assert heights[1] == pytest.approx(0.018 * scale, rel=1e-3)
    run(page, "section.setHole(null)")
    assert "regolith" not in page.tab.inner_html("#section")
    run(page, "section.setContact(false)")
    assert not page.tab.query_selector("#section .crushed")
    assert page.tab.is_visible("#section .air")


def test_no_name_of_a_layer_runs_into_the_hole(opened):
    page = opened(width=PHONE)
    name = "weak sandstone of the upper member"
    run(page, "clock.jump(sections.first, true)")
    hole(page, depth=0.018, layers=[{"from": 0, "to": None, "name": name, "colour": 3}])
    page.until(f"document.querySelector('#section .halo.now').textContent === '{name}'")
    left, wall = (
        run(page, f"return document.querySelector('{each}').getBoundingClientRect().{side}")
        for each, side in (("#section .halo.now", "left"), ("#section .hole", "right"))
    )
    assert left > wall


def test_the_place_of_the_bit_is_that_of_the_arm_and_the_hole_stays(opened):
    page = opened()
    run(page, "clock.jump(sections.first, true); section.setContact(true)")
    tips = []
    for tip in (0.0182, 0.009, 0.0, -0.005, -5.0):
        hole(page, tip=tip)
        run(page, f"section.setContact({json.dumps(tip > 0.0178)})")
        tips.append(run(page, "return at('bit') + 400"))
        for name in ("regolith", "rate", "torque"):
            assert name in page.tab.inner_html("#section")
        assert page.tab.is_visible("#section .air") == (tip < 0.0178)
    face = 506
    bottom = tips[0]
    assert tips[1] - face == pytest.approx((bottom - face) / 2, abs=1.0)
    assert tips[2] == pytest.approx(face)
    assert face - 37 < tips[4] < tips[3] < face
    hole(page)  # without an arm the regime says it
    run(page, "section.setContact(false)")
    assert run(page, "return at('bit') + 400") < face
    assert "sandstone" in page.tab.inner_html("#section")
