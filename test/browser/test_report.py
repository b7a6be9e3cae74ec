"""The report of a bag in a real browser: zoom, cursor, keyboard, marks, themes, widths."""

import re

import numpy as np
import pytest
from rpud_sim.inspection.report.bag_report import write_report
from sample_bags import SECOND, START, serialized

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.inspection.offline_bag import write_offline_bag
from rpud_sim.simulation import WeightOnBit
from rpud_sim.simulation.changes import Planned
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.scenario import read_scenario

pytestmark = pytest.mark.extended

DURATION = 2.0
SCENARIO = "faults:\n  - {kind: bias, channel: wrench, magnitude: 100, onset: 1.0, duration: 0.5}\n"
PEAKS = "peak contact force"
TOPICS = ("contact_force", "faults", "journal", "nodal_plane", "reacting_force", "status")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "scenario.yaml").write_text(SCENARIO)
    beginning = Beginning(Settings(), scenario=read_scenario(folder / "scenario.yaml"))
    planned = (Planned(SECOND // 2, WeightOnBit(40.0)),)
    path = folder / "bag"
    write_offline_bag(path, beginning, DURATION, planned=planned, topics=TOPICS)
    return path


@pytest.fixture(scope="module")
def report(bag):
    write_report(bag, bag.parent / "report.html")
    return bag.parent / "report.html"


@pytest.fixture
def page(report, page_of):
    page = page_of(report)
    page.tab.locator("figure.plot", has_text=PEAKS).first.scroll_into_view_if_needed()
    page.until("rpudPlots.plots.size >= 3")
    page.settle()
    return page


def areas(page):
    """Give the areas of the first plots, over time."""
    return page.tab.locator("figure.plot[data-group=time] .plot-area")


def ranges(page):
    """Give the range that each plot in view has."""
    return page.tab.evaluate(
        "[...rpudPlots.plots.values()].filter((p) => p.visible && p.group.key === 'time')"
        ".map((p) => [p.model.x_range.start, p.model.x_range.end])"
    )


def cursor(page):
    """Give the time at the cursor [s], and what is said there."""
    text = page.tab.locator(".plot-cursor").first.text_content()
    return float(re.match(r"at ([\d.]+) s", text)[1]), text


def test_a_plot_zooms_and_all_others_with_it(page):
    box = areas(page).first.bounding_box()
    y = box["y"] + 0.5 * box["height"]
    page.tab.mouse.move(box["x"] + 0.4 * box["width"], y)
    page.tab.mouse.down()
    page.tab.mouse.move(box["x"] + 0.6 * box["width"], y, steps=5)
    page.tab.mouse.up()
    page.until("(rpudPlots.groups.get('time').range || [0, 2])[0] > 0.1")
    found = np.array(ranges(page))
    assert len(found) > 1
    assert (found == found[0]).all()
    assert 0.5 < found[0][0] < found[0][1] < 1.5
    # A plot that comes into view later has the same time.
    page.tab.locator("h2#faults").scroll_into_view_if_needed()
    page.until("[...rpudPlots.plots.values()].some((p) => p.visible && /faults/.test("
               "p.host.textContent) && p.group.key === 'time')")  # fmt: skip
    assert (np.array(ranges(page)) == found[0]).all()
    page.tab.locator(".plot-controls[data-group=time] [data-act=whole]").last.click()
    assert ranges(page)[0] == [0.0, pytest.approx(DURATION, abs=0.05)]
    page.assert_quiet()


def test_the_keyboard_moves_zooms_and_reads(page):
    areas(page).first.focus()
    page.tab.keyboard.press("+")
    first = ranges(page)[0]
    assert first[1] - first[0] == pytest.approx(DURATION / 1.6, rel=0.05)
    page.tab.keyboard.press("ArrowRight")
    moved = ranges(page)[0]
    assert moved[0] > first[0]
    assert moved[1] - moved[0] == pytest.approx(first[1] - first[0])
    page.tab.keyboard.press("-")
    page.tab.keyboard.press("ArrowLeft")
    page.tab.keyboard.press("Shift+ArrowRight")
    time, _ = cursor(page)
    spoken = page.tab.locator(".plot-spoken").first.text_content()
    assert spoken.startswith(f"at {time:.3f}"[:6])
    assert PEAKS in spoken
    page.tab.keyboard.press("Home")
    assert ranges(page)[0][0] == 0.0
    page.tab.keyboard.press("Escape")
    assert page.tab.locator(".plot-cursor").first.text_content() == ""


def test_the_cursor_shows_the_values_that_are_in_the_bag(page, bag):
    with rpud_sim.bag.open(bag) as opened:
        columns = opened.arrays("/rpud/nodal_plane")
    times = columns["header.stamp"] / 1e9
    figure = page.tab.locator("h3", has_text="/rpud/nodal_plane").locator(
        "xpath=following::figure[.//span[starts-with(., 'position')]][1]"
    )
    figure.scroll_into_view_if_needed()
    name = figure.get_attribute("data-plot")
    page.until(f"rpudPlots.plots.has('{name}')")
    unit = re.search(r"\[(.*)\]", figure.locator(".plot-title").text_content())[1]
    factor = {"m": 1.0, "mm": 1e3, "µm": 1e6}[unit]
    for wanted in (0.301, 0.8, 1.234):
        page.tab.evaluate(f"rpudPlots.setCursor(rpudPlots.groups.get('time'), {wanted})")
        shown = float(figure.locator("output").first.text_content().split()[0])
        held = columns["position"][np.searchsorted(times, wanted, side="right") - 1]
        assert shown == pytest.approx(factor * held, rel=1e-3)


def test_a_hostile_bag_runs_nothing(tmp_path, page_of):
    evil = "/</script><script>window.hacked = 1</script>"
    definition = "float64 value # [</style><img src=x onerror='window.hacked = 1'>]\n"
    with BagWriter(tmp_path / "bag") as bag:
        bag.add_topic(Topic(evil, "pkg/msg/Evil"), definition)
        for number in range(20):
            data = serialized("pkg/msg/Evil", definition, {"value": float(number % 7)})
            bag.write(evil, data, START + number * 10**8, START)
    write_report(tmp_path / "bag", tmp_path / "report.html")
    page = page_of(tmp_path / "report.html")
    page.tab.evaluate("rpudPlots.drawAll()")
    page.check()
    assert page.tab.evaluate("window.hacked") is None
    assert evil in page.tab.locator("h3").all_text_contents()
