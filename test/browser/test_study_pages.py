"""Pages of sweeps and campaigns in Chromium: zoom, values, themes, widths."""

from pathlib import Path

import pytest
from browser.pages import PHONE, WIDE
from campaign_results import FAILURE, flown

from rpud_sim.studies.sweep.specification_file import parse_specification
from rpud_sim.studies.sweep.sweep import run_sweep
from rpud_sim.testing.campaign.campaign_file import read_campaign
from rpud_sim.testing.campaign.page import campaign_page

pytestmark = pytest.mark.extended

CONFIG = Path(__file__).resolve().parents[2] / "config"
SWEEP = {
    "design": "grid",
    "repeat": 2,
    "duration": 0.05,
    "swept": {
        "weight_on_bit": {"minimum": 10, "maximum": 40, "points": 4},
        "contact_model": ["printed", "rayleigh"],
    },
}
# Data of a plot's layer as the page has them.
DATA = """([title, layer]) => {
  const host = [...document.querySelectorAll('figure.plot')].find(
    (each) => each.querySelector('.plot-title').textContent.startsWith(title));
  const plot = rpudPlots.plots.get(host.dataset.plot);
  for (const model of plot.model.references())
    if (model.type === 'ColumnDataSource' && model.name === layer) {
      const get = (name) => [...(model.data.get ? model.data.get(name) : model.data[name])];
      return { x: get('x'), y: get('y'), name: host.dataset.plot };
    }
}"""


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    return run_sweep(parse_specification(SWEEP), tmp_path_factory.mktemp("sweep") / "out", 1).report


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """The page of a campaign whose outcomes are given."""
    read = read_campaign(CONFIG / "campaign.yaml")
    broken = read.runs[2]
    results = flown(read, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    path = tmp_path_factory.mktemp("campaign") / "index.html"
    path.write_text(campaign_page(results))
    return path


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        ("sweep", WIDE, "light"),
        ("campaign", WIDE, "dark"),
        ("campaign", PHONE, "light"),
    ],
)
def test_a_page_is_for_all_readers(request, page_of, name, width, scheme):
    page = page_of(request.getfixturevalue(name), width=width, scheme=scheme)
    page.tab.evaluate("rpudPlots.drawAll()")
    page.check()
    page.keep(f"{name}_{width}_{scheme}", whole=True)


def test_values_at_the_cursor_are_those_of_the_table(sweep, page_of):
    import pyarrow.parquet as pq

    points = pq.read_table(sweep.parent / "points.parquet").to_pandas()
    page = page_of(sweep)
    page.tab.evaluate("rpudPlots.drawAll()")
    shown = page.tab.evaluate(DATA, ["reacting_force_mean", "mean with its 95 % interval"])
    means = points.groupby("weight_on_bit")["reacting_force_mean"].mean()
    assert shown["x"] == list(means.index)
    assert shown["y"] == pytest.approx(list(means))
    page.tab.evaluate("([name, x]) => rpudPlots.setCursor(rpudPlots.plots.get(name).group, x)",
                      [shown["name"], 20.0])  # fmt: skip
    host = page.tab.locator(f'figure[data-plot="{shown["name"]}"]')
    host.scroll_into_view_if_needed()
    selector = f'figure[data-plot="{shown["name"]}"] .key[data-layer="1"] output'
    page.until(f"document.querySelector('{selector}').textContent !== ''")
    text = page.tab.locator(selector).inner_text()
    assert float(text.split()[0]) == pytest.approx(means[20.0], rel=1e-3)
    page.assert_quiet()


def test_plots_over_one_parameter_zoom_together_by_buttons_and_keys(sweep, page_of):
    page = page_of(sweep)
    page.tab.evaluate("rpudPlots.drawAll()")
    bar = page.tab.get_by_role("group", name="Range of weight_on_bit")
    whole = bar.locator(".plot-range").inner_text()
    assert whole.endswith(" N")
    ranges = """() => [...rpudPlots.groups.get('weight_on_bit-1').plots].slice(0, 3)
      .map((p) => p.model.x_range.end - p.model.x_range.start)"""
    before = page.tab.evaluate(ranges)
    bar.get_by_role("button", name="zoom in").click()
    after = page.tab.evaluate(ranges)
    assert len(after) == 3
    assert all(new < 0.7 * old for new, old in zip(after, before, strict=True))
    page.tab.locator(".plot-area").first.focus()
    page.tab.keyboard.press("Home")
    page.until(f"document.querySelector('.plot-range').textContent === '{whole}'")
    assert page.tab.evaluate(ranges) == pytest.approx(before)


def test_failures_of_a_campaign_are_at_their_run(campaign, page_of):
    page = page_of(campaign)
    page.tab.evaluate("rpudPlots.drawAll()")
    failed = page.tab.evaluate(DATA, ["margin: force", "failed"])
    assert (failed["x"], failed["y"]) == ([3.0], [-1.5])
