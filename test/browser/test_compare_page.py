"""The page of `rpud compare` in a browser: it draws every plot, and its numbers are the runs'."""

import pytest
from browser.pages import PHONE
from sample_bags import write_offline_bag

from rpud_sim.inspection.compare import compare
from rpud_sim.inspection.compare.compare_page import write_page
from rpud_sim.simulation import preset, read_scenario

pytestmark = pytest.mark.extended

HOSTILE = "<script>document.title = 'taken'</script>"


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    drilling = preset("drilling")
    (folder / "faults.yaml").write_text(
        "faults: [{kind: bias, channel: wrench, magnitude: 3, onset: 0.5, duration: 0.1}]"
    )
    scenario = read_scenario(folder / "faults.yaml")
    write_offline_bag(folder / HOSTILE.replace("/", ""), drilling, 1.0, 0.1, scenario)
    write_offline_bag(folder / "b", drilling.replace(weight_on_bit=40.0), 1.0, 0.2)
    write_offline_bag(folder / "c", drilling, 1.0, 0.3)
    found = compare([folder / HOSTILE.replace("/", ""), folder / "b", folder / "c"], settle=0.1)
    write_page(found, folder / "page.html")
    return found, folder / "page.html"


@pytest.mark.parametrize(("width", "scheme"), [(1400, "light"), (PHONE, "dark")])
def test_the_page_is_whole(page_of, compared, width, scheme):
    found, path = compared
    page = page_of(path, width=width, scheme=scheme, reduced_motion=True)
    assert "taken" not in page.tab.title()
    plots = page.tab.locator("figure.plot")
    assert plots.count() > 15
    for number in (0, plots.count() - 1):
        plots.nth(number).scroll_into_view_if_needed()
        plots.nth(number).locator(".plot-drawing > *").first.wait_for(state="attached")
    assert found.verdict in page.tab.locator("main p").first.inner_text().lower()
    page.check()
    page.keep(f"compare_{width}_{scheme}")


def test_numbers_on_the_page_are_those_of_the_comparison(page_of, compared):
    found, path = compared
    page = page_of(path)
    rate = found.windows[0].quantities[0]
    row = page.tab.locator("tr", has_text="impact rate").first
    cells = row.locator("td").all_inner_texts()
    assert cells[:3] == ["impact rate", "mean", "B"]
    assert float(cells[3]) == pytest.approx(rate.runs[0].estimates["mean"].value, rel=1e-4)
    assert float(cells[4]) == pytest.approx(rate.runs[1].estimates["mean"].value, rel=1e-4)
    assert cells[-1] == rate.differences[0][0].decision
    assert "bias of wrench magnitude 3" in page.tab.locator("main").inner_text()
