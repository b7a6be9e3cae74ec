"""Results of a campaign: the matrix, its table, JSON and the page."""

import json
from pathlib import Path

import pytest
from campaign_results import FAILURE, OPEN, attempt

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import SYSTEM, campaign_page, results_from_reports
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

EXAMPLE = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(EXAMPLE)


def test_a_requirement_fails_in_the_scenario_where_a_run_breaks_it(campaign):
    broken = next(run for run in campaign.runs if run.scenario == "jammed")
    results = attempt(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    assert [name for name, each in results.outcomes.items() if each == FAILED] == ["SAFE-1"]
    cell = results.cells["SAFE-1", "jammed"]
    assert (cell.outcome, cell.margin, cell.unit, cell.reaction_time) == (FAILED, -1.5, "N", 0.25)
    assert cell.worst.run is broken
    assert results.lines()[3].split() == [
        *("SAFE-1", "failed", "passed", "2", "N", "in", "0.25", "s"),
        *("failed", "-1.5", "N", "in", "0.25", "s", *2 * ("passed", "2", "N", "in", "0.25", "s")),
    ]
    headline, _, rest = campaign_page(results).partition("<h2>")
    assert '<b class="failed">failed</b>: 5 passed, 1 failed, 0 undecided of' in headline
    failures = rest.partition("<h2>What failed</h2>")[2].partition("<h2>")[0]
    assert failures.count("<h3>") == 1
    assert f"<h3>{broken.name}</h3>" in failures
    assert "[SAFE-1] force: failed: reacting_force.force was 501.5 N at 4.5 s" in failures


def test_a_requirement_that_no_run_decides_has_not_passed(campaign):
    results = attempt(campaign, lambda run: {"judged": {"drive off": OPEN}})
    assert results.undecided == {"SAFE-2": OPEN[-1]}
    decided = attempt(
        campaign,
        lambda run: {} if run.scenario == "jammed" else {"judged": {"drive off": OPEN}},
    )
    assert set(decided.outcomes.values()) == {PASSED}
    assert (results.verdict, decided.verdict) == (UNDECIDED, PASSED)
    page = campaign_page(decided)
    assert page.count("n/a: no free mass jammed here") == 3  # nominal, biased and lost preload
    assert "free_mass_jammed" not in page.partition("<h2>Runs")[0]


def test_a_requirement_without_an_expectation_has_not_passed(campaign):
    further = {**campaign.requirements, "SAFE-9": "It never melts."}
    results = attempt(campaign._replace(requirements=further))
    assert results.outcomes["SAFE-9"] == UNDECIDED
    assert "no verdict" in campaign_page(results)
    assert results.lines()[-1] == "requirements: 6 passed, 0 failed, 1 undecided"


def test_a_system_under_test_that_dies_is_a_verdict_of_its_own(campaign):
    text = "supervisor.py ended with exit code 3, at 0.4 s of simulation time\n    out of memory"
    results = attempt(campaign, lambda run: {"ending": "died", "text": text})
    assert results.outcomes[SYSTEM] == FAILED
    assert results.runs[0].failures == [text]
    assert "out of memory" in campaign_page(results)


def test_the_page_escapes_names_and_links_to_bags(campaign):
    page = campaign_page(attempt(campaign._replace(name="<script>alert(1)</script>")))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert 'href="nominal%20' in page


def test_results_travel_as_plain_values_and_are_json_without_infinity(campaign):
    made = attempt(campaign, lambda run: {"judged": {"force": FAILURE, "drive off": OPEN}})
    content = json.loads(json.dumps(made.to_dict(), allow_nan=False))
    assert content["counts"] == {"passed": 4, "failed": 1, "undecided": 1}
    reports = [each | {"name": each["run"]} for each in content["runs"]]
    again = results_from_reports(EXAMPLE, reports, Path())
    assert [each._replace(bag="") for each in made.runs] == list(again.runs)
