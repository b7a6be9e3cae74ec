"""Page of a comparison: its sentence, its differences with whole intervals, its tables."""

import math
import os
import re

import pytest
from sample_bags import write_offline_bag

from rpud_sim.inspection.compare import compare
from rpud_sim.inspection.compare import page as pages
from rpud_sim.inspection.compare.estimates import DIFFERS
from rpud_sim.inspection.compare.page import render
from rpud_sim.inspection.compare.plots import difference_plot, time_plots
from rpud_sim.pages.plot import Points, Zone, axis_ends
from rpud_sim.simulation import preset, read_scenario

DRILLING = preset("drilling")
SCENARIO = """
faults:
  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.25, duration: 1.0}
"""


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    (folder / "scenario.yaml").write_text(SCENARIO)
    scenario = read_scenario(folder / "scenario.yaml")
    write_offline_bag(folder / "a", DRILLING, 2.0, 0.1)
    write_offline_bag(folder / "heavier", DRILLING.replace(weight_on_bit=20.0), 2.0, 0.6)
    write_offline_bag(folder / "one", DRILLING, 2.0, 0.1, scenario)
    write_offline_bag(folder / "two", DRILLING, 2.0, 0.6, scenario)
    return folder


@pytest.fixture(scope="module")
def found(bags):
    return compare([bags / "a", bags / "heavier"])


def plain(page):
    """Return the text of a page."""
    return " ".join(re.sub(r"<[^>]*>", " ", page).split())


def test_the_first_that_is_seen_is_one_sentence(found):
    text = found.sentence
    page = render(found)
    assert page.index(text) < page.index("<svg")
    count = sum(each.decision == DIFFERS for each in found.differences)
    assert text.startswith(f"{count} of {len(found.differences)} figures differ, most of all ")
    assert text.count(". ") == 0
    assert "weight_on_bit 8 and 20 N" in plain(page)


def test_intervals_are_never_cut_off(found):
    plot = difference_plot(found, found.windows[0])
    low, high = axis_ends(plot, "x")
    known = [each for each in found.differences if math.isfinite(each.relative)]
    drawn = [layer for layer in plot.layers if isinstance(layer, Points)]
    assert sum(len(layer.x) for layer in drawn) == len(known)
    assert low < 100.0 * min(each.relative_low for each in known)
    assert high > 100.0 * max(each.relative_high for each in known)
    assert {layer.name for layer in drawn} == {each.decision for each in known}


def test_values_stand_beside_their_rows_in_the_units_of_people(found):
    plot = difference_plot(found, found.windows[0])
    row = plot.y.categories.index("peak force, mean")
    assert plot.y.categories[row + 1 : row + 3] == ("median", "95 % quantile")
    cells = dict(plot.y.columns)
    peak = next(q for q in found.windows[0].quantities if q.quantity == "peak_force")
    one, other = (run.estimates["mean"].value for run in peak.runs)
    assert (cells["A"][row], cells["B"][row]) == (
        peak.compared.shown.text(one),
        peak.compared.shown.text(other),
    )
    assert cells["A"][row].endswith(" kN")
    assert re.fullmatch(r"[-+][\d.]+ %", cells["difference"][row])
    assert not re.search(r"\de[-+]", " ".join(text for column in cells.values() for text in column))


def test_the_tables_are_behind_a_click(found):
    page = render(found)
    start = page.index("<details")
    assert "<table" not in page[:start]
    rate = found.windows[0].quantities[0]
    one, other = (rate.compared.shown.text(run.estimates["mean"].value) for run in rate.runs)
    assert f"{rate.compared.shown.label} mean B {one} {other}" in plain(page)
    assert page.count("<details") == page.count("</details")
    assert " open" not in re.sub(r"<style>.*?</style>", "", page, flags=re.DOTALL)


def test_a_page_needs_no_script(found):
    page = render(found)
    assert "<script" not in page
    [policy] = re.findall('Content-Security-Policy" content="([^"]+)"', page)
    assert "default-src 'none'" in policy
    assert "script-src" not in policy
    assert len(page.encode()) < 300_000


def test_each_segment_has_its_differences_and_faults_are_over_time(bags):
    found = compare([bags / "one", bags / "two"], settle=0.1)
    assert len(found.windows) == 3
    page = render(found)
    assert page.count("<title>Differences from A, with 95 % intervals</title>") == 3
    plots = time_plots(found)
    assert {"impacts", "peak force", "load on the mount", "nodal plane"} <= {p.title for p in plots}
    [fault] = [layer for layer in plots[0].layers if isinstance(layer, Zone)]
    assert (fault.low, fault.high) == (pytest.approx(0.25), pytest.approx(1.25))
    assert "bias" in fault.text
    peak = next(plot for plot in plots if plot.title == "peak force")
    envelope = next(
        layer for layer in peak.layers if getattr(layer, "low", None) is not None and layer.name
    )
    values = found.values[0].topics["contact_force"]["peak_force"]
    assert envelope.high.max() == pytest.approx(1e-3 * values.max())
    assert envelope.low.min() == pytest.approx(1e-3 * values.min())


def test_three_runs_have_a_colour_each(bags):
    found = compare([bags / "a", bags / "heavier", bags / "one"], tolerance=0.05)
    plot = difference_plot(found, found.windows[0])
    names = [layer.name for layer in plot.layers if layer.name]
    assert names == ["tolerance", "B heavier against A", "C one against A"]
    assert plot.y.columns == ()


def test_a_page_that_cannot_be_written_whole_is_not_there(tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "render", lambda found: "half \ud800")
    with pytest.raises(UnicodeEncodeError):
        pages.write_page(None, tmp_path / "page.html")
    assert os.listdir(tmp_path) == []
