"""The page of a bag in a real browser: marks, playing, and zooming down to one contact."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from browser.pages import PHONE, SCHEMES, WIDE
from sample_bags import write_offline_bag
from support import Process
from watch.recorded.recorded_bags import FAULTS, FORCE

import rpud_sim.bag
from rpud_sim.bag import BagWriter, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario import read_scenario

pytestmark = pytest.mark.extended

HOSTILE = "/rpud/<img src=x onerror=alert(1)>"
DURATION = 10.5  # longer than what is drawn from single messages at once
DRAWN = "document.documentElement.dataset.drawn === 'true'"


@dataclass(frozen=True)
class Drilled:
    """Bag on a server, and the impacts in it."""

    path: Path
    url: str
    impacts: dict[str, np.ndarray]


@pytest.fixture(scope="module")
def drilled(tmp_path_factory):
    """Drill with two faults, and a topic whose name is HTML."""
    folder = tmp_path_factory.mktemp("bag_page")
    (folder / "faults.yaml").write_text(FAULTS, encoding="utf-8")
    scenario = read_scenario(folder / "faults.yaml")
    write_offline_bag(folder / "whole", preset("drilling"), DURATION, scenario=scenario)
    path = folder / "drilled"
    with (
        rpud_sim.bag.open(folder / "whole") as reader,
        BagWriter(path, chunk_size=1 << 18) as writer,
    ):
        kept = [each for each in reader.topics if each.topic.name != "/rpud/waveform"]
        for summary in kept:
            writer.add_topic(summary.topic, summary.definition)
        writer.add_topic(Topic(HOSTILE, FORCE, find_type_hash(FORCE)), find_definition(FORCE))
        for message in reader.messages({each.topic.name for each in kept}):
            writer.write(message.topic, message.data, message.log_time, message.publish_time)
            if message.topic == "/rpud/reacting_force":
                writer.write(HOSTILE, message.data, message.log_time, message.publish_time)
        impacts = reader.arrays("/rpud/contact_force", 2 * 10**9, 10**8)
    with Process("rpud", "watch", path, "--port", "0") as server:
        yield Drilled(path, server.wait_for_line(r"bag .*: (http://\S+)")[1], impacts)


@pytest.fixture
def open_bag(page_of, drilled):
    def open_page(**options):
        page = page_of(drilled.url, **options)
        page.until(DRAWN)
        return page

    return open_page


def values_of(page, plot, layer):
    """Return what a layer of a plot has drawn: x and y."""
    x, y = page.tab.evaluate(
        """([plot, layer]) => {
          for (const model of rpudPlots.plots.get(plot).model.references())
            if (model.name === layer && model.data) {
              const { data } = model;
              return ["x", "y"].map((name) => Array.from(data.get ? data.get(name) : data[name]));
            }
        }""",
        [plot, layer],
    )
    return np.array(x, float), np.array(y, float)


def put_cursor(page, time):
    page.tab.fill("#time", str(time))
    page.tab.press("#time", "Enter")
    page.until(f"Math.abs(rpudBag.pinned - {time}) < 1e-9")


def test_a_zoom_into_a_contact_shows_its_peak_force(open_bag, drilled):
    impacts = drilled.impacts
    times = impacts["header.stamp"] / 1e9
    following = int(np.flatnonzero(times > 2.02)[0])
    page = open_bag()
    put_cursor(page, 2.02)
    page.tab.get_by_role("button", name="next impact").click()
    page.until("document.getElementById('said').textContent.startsWith('Impact at')")
    assert f"Impact at {times[following]:.9f} s" in page.tab.inner_text("#said")
    page.tab.get_by_role("button", name="zoom to this contact").click()
    page.until("document.documentElement.dataset.detail === 'waveform'")
    page.until(f"rpudPlots.groups.get('time').range[0] > {times[following] - 1e-3}")
    contact = impacts["contact_duration"][following]
    page.until("(([a, b]) => b - a < 1e-3)(JSON.parse(document.documentElement.dataset.answered))")
    _, force = values_of(page, "plot-0", "rebuilt force")
    # A nanosecond between samples: the peak of a half sine of 9 us is met within 1e-7.
    assert np.nanmax(force) == pytest.approx(impacts["peak_force"][following], rel=1e-6)
    x, _ = values_of(page, "plot-0", "rebuilt force")
    assert len(x) > 200
    assert x[-1] - x[0] == pytest.approx(2.08 * contact, rel=0.05)
    page.tab.get_by_role("button", name="previous impact").click()
    page.until(f"Math.abs(rpudBag.pinned - {times[following - 1]}) < 2e-9")
    page.keep("contact")
    page.assert_quiet()


def test_marks_are_shown_and_playing_moves_the_cursor(open_bag):
    page = open_bag()
    page.until("document.querySelectorAll('#marks tr').length >= 3")
    text = page.tab.inner_text("#marks")
    assert "bias of reacting_force 5" in text
    assert "restitution_loss" in text
    assert "a run begins" in text
    page.tab.locator("#marks button").nth(1).click()
    page.until("rpudBag.pinned === 0.4")
    assert "bias of reacting_force" in page.tab.locator(".plot-cursor").last.inner_text()

    page.tab.evaluate("rpudPlots.setRange(rpudPlots.groups.get('time'), 1.0, 1.5)")
    put_cursor(page, 1.4)
    page.tab.click("#play")
    page.until("rpudBag.pinned > 1.6 && rpudPlots.groups.get('time').range[0] > 1.4")
    page.tab.click("#play")
    page.until("!rpudBag.playing")
    stopped = page.tab.evaluate("rpudBag.pinned")
    page.settle()
    assert page.tab.evaluate("rpudBag.pinned") == stopped
    page.until("JSON.parse(document.documentElement.dataset.answered)[1] > 1.6")
    page.tab.select_option("#speed", "100.0")
    page.tab.click("#play")
    page.until("!rpudBag.playing")  # at the end it stops by itself
    assert page.tab.evaluate("rpudBag.pinned === rpudPlots.groups.get('time').whole[1]")
    page.assert_quiet()


def test_the_reader_chooses_a_signal_and_a_hostile_name_stays_text(open_bag):
    page = open_bag()
    choice = page.tab.locator("select[data-plot-number]").first
    name = f"{HOSTILE} force [N]"
    assert name in choice.locator("option").all_inner_texts()
    choice.select_option(label=name)
    number = choice.get_attribute("data-plot-number")
    page.tab.evaluate("rpudPlots.setRange(rpudPlots.groups.get('time'), 3, 4)")
    page.until("document.documentElement.dataset.detail === 'messages'")
    _, chosen = values_of(page, f"plot-{number}", "value")
    _, force = values_of(page, "plot-3", "reacting force")
    assert chosen.tolist() == force.tolist()
    assert page.tab.locator("img").count() == 0
    page.assert_quiet()


@pytest.mark.parametrize("width", [PHONE, WIDE])
def test_it_can_be_read_by_everybody(open_bag, width):
    page = open_bag(width=width)
    page.until("document.getElementById('read').textContent.startsWith('The whole bag')")
    for scheme in SCHEMES:
        page.show(scheme)
        page.settle()
        page.keep(f"bag_{width}_{scheme}")
        page.check()


def test_a_bag_that_is_deleted_while_it_is_shown_leaves_a_banner(open_bag, drilled):
    page = open_bag()
    shutil.rmtree(drilled.path)
    page.until("document.getElementById('banner').textContent.includes('was deleted')")
    page.tab.evaluate("rpudPlots.setRange(rpudPlots.groups.get('time'), 5.0, 5.01)")
    page.until("document.documentElement.dataset.detail === 'waveform'")
    page.assert_quiet()
