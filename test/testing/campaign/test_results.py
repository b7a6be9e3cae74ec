"""Results of a campaign: the matrix, its table, JSON and the page."""

import dataclasses
import json
from pathlib import Path

import pytest
from campaign_results import FAILURE, OPEN, flown, outcome

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_results import campaign_page
from rpud_sim.testing.campaign_runs import SYSTEM, outcome_from_json
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

EXAMPLE = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(EXAMPLE)


def outcomes(results):
    return {each.identifier: each.outcome for each in results.requirements}


def test_a_requirement_fails_in_the_scenario_where_a_run_breaks_it(campaign):
    broken = next(run for run in campaign.runs if run.scenario.name == "jammed")
    results = flown(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    (requirement,) = [each for each in results.requirements if each.outcome == FAILED]
    assert requirement.identifier == "SAFE-1"
    cell = requirement.cells["jammed"]
    assert (cell.outcome, cell.margin, cell.unit, cell.reaction_time) == (FAILED, -1.5, "N", 0.25)
    assert cell.worst.run is broken
    assert requirement.cells["nominal"].outcome == PASSED
    assert results.lines()[3].split() == [
        *("SAFE-1", "failed", "passed", "2", "N", "in", "0.25", "s"),
        *("failed", "-1.5", "N", "in", "0.25", "s", *2 * ("passed", "2", "N", "in", "0.25", "s")),
    ]


def test_a_requirement_that_no_run_decides_has_not_passed(campaign):
    results = flown(campaign, lambda run: {"judged": {"drive off": OPEN}})
    assert outcomes(results)["SAFE-2"] == UNDECIDED
    decided = flown(
        campaign,
        lambda run: {} if run.scenario.name == "jammed" else {"judged": {"drive off": OPEN}},
    )
    assert set(outcomes(decided).values()) == {PASSED}


def test_a_requirement_without_an_expectation_has_not_passed(campaign):
    further = {**campaign.requirements, "SAFE-9": "It never melts."}
    results = flown(dataclasses.replace(campaign, requirements=further))
    assert results.requirements[-1].outcome == UNDECIDED
    assert "no verdict" in campaign_page(results)
    assert results.lines()[-1] == "requirements: 6 passed, 0 failed, 1 undecided"


def test_a_system_under_test_that_dies_is_a_verdict_of_its_own(campaign):
    text = "supervisor.py ended with exit code 3, at 0.4 s of simulation time\n    out of memory"
    results = flown(campaign, lambda run: {"ending": "died", "text": text})
    assert outcomes(results)[SYSTEM] == FAILED
    assert results.runs[0].outcome.failures == [text]
    assert "out of memory" in campaign_page(results)


def test_the_page_escapes_names_and_links_to_bags(campaign):
    named = dataclasses.replace(campaign, name="<script>alert(1)</script>")
    page = campaign_page(flown(named))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert 'href="nominal%20' in page


def test_the_page_names_runs_that_failed_and_plots_their_margins_apart(campaign):
    broken = campaign.runs[4]
    page = campaign_page(
        flown(campaign, lambda run: {"judged": {"force": FAILURE}} if run is broken else {})
    )
    failures = page.partition("<h2>What failed</h2>")[2].partition("<h2>")[0]
    assert failures.count("<h3>") == 1
    assert f"<h3>{broken.name}</h3>" in failures
    assert "[SAFE-1] force: failed, margin -1.5 N: broken at 4.5 s" in failures
    assert "Worst: -1.5 N in run 5." in page
    assert "What failed" not in campaign_page(flown(campaign))


def test_an_outcome_travels_as_text_and_results_are_json_without_infinity(campaign):
    made = outcome(campaign, {"force": FAILURE, "drive off": OPEN})
    assert outcome_from_json(made.to_json()) == made
    content = json.loads(json.dumps(flown(campaign).to_dict(), allow_nan=False))
    assert content["counts"] == {"passed": 6, "failed": 0, "undecided": 0}
