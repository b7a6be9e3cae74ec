"""Pages that are files: each works without network, on a phone, in light and dark."""

from pathlib import Path

import pytest
from browser_pages import HEIGHT, PHONE, WIDE
from campaign_results import FAILURE, attempt
from sample_bags import STRING_DEFINITION, TALK, serialized_string, write_offline_bag

from rpud_sim.bag import BagWriter, Topic
from rpud_sim.cli.main import main
from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import read_scenario
from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import campaign_page

pytestmark = pytest.mark.extended

CAMPAIGN = Path(__file__).resolve().parents[2] / "config" / "campaign.yaml"
SCENARIO = """
faults:
  - {kind: bias, channel: wrench, magnitude: 100, onset: 0.25, duration: 0.5}
  - {kind: free_mass_jammed, onset: 0.7}
"""
HOSTILE = (
    '/rpud/<script>console.error("x")</script><img src=x onerror=alert(1)>/{{ 7*7 }}/' + "W" * 300
)


def drilled(folder):
    (folder / "scenario.yaml").write_text(SCENARIO)
    scenario = read_scenario(folder / "scenario.yaml")
    write_offline_bag(folder / "bag", preset("drilling"), 1.0, scenario=scenario)
    return "report", folder / "bag", "--out", folder / "out.html"


def hostile(folder):
    """A bag whose topics and texts are those of an attacker."""
    with BagWriter(folder / "bag") as bag:
        for name in (HOSTILE, "/rpud/\u202eevil", TALK.name):
            bag.add_topic(Topic(name, TALK.type, TALK.type_hash), STRING_DEFINITION)
            for number in range(5):
                bag.write(name, serialized_string(HOSTILE), number, number)
    return "report", folder / "bag", "--out", folder / "out.html"


def compared(folder):
    drilled(folder)
    other = folder / "<script>console.error(1)<"
    write_offline_bag(other, preset("drilling").replace(weight_on_bit=20.0), 1.0)
    return "compare", folder / "bag", other, "--out", folder / "out.html"


def judged_campaign(folder):
    """The page of a campaign whose outcomes are given."""
    campaign = read_campaign(CAMPAIGN)
    broken = campaign.runs[2]
    results = attempt(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    (folder / "index.html").write_text(campaign_page(results))


PAGES = {
    "report": drilled,
    "hostile report": hostile,
    "comparison": compared,
    "campaign": judged_campaign,
}


@pytest.fixture(scope="module", params=PAGES)
def file(request, tmp_path_factory):
    """File of a page, made from a real bag by its command."""
    folder = tmp_path_factory.mktemp("page")
    if words := PAGES[request.param](folder):
        with pytest.raises(SystemExit) as end:
            main([str(word) for word in words])
        assert end.value.code in (0, 1, 3)
    (page,) = folder.rglob("*.html")
    return page


STATIC = ("comparison", "campaign")
SCREENS = 4


# Neither contrast depends on the width nor width on the colours: two readers see all.
@pytest.mark.parametrize(("width", "scheme"), [(PHONE, "dark"), (WIDE, "light")])
def test_a_page_is_good(file, page_of, width, scheme):
    page = page_of(file, width=width, scheme=scheme, offline=True)
    page.settle()
    page.keep("page")
    page.check()


def test_a_page_of_results_is_short_and_static(file, page_of, request):
    if request.node.callspec.params["file"] not in STATIC:
        pytest.skip("a report is another kind of page")
    page = page_of(file, offline=True)
    page.settle()
    assert page.tab.evaluate("document.documentElement.scrollHeight") < SCREENS * HEIGHT
    assert page.tab.evaluate("document.scripts.length") == 0
    for picture in page.tab.locator("svg[role=img]").all():
        assert picture.locator("> title").text_content()
    page.tab.evaluate(
        "() => document.querySelectorAll('details').forEach((e) => { e.open = true; })"
    )
    page.check()
    page.keep("open")
