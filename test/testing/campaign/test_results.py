"""Results of a campaign: the matrix, the exit, JUnit, the page, and what a digest covers."""

import dataclasses
import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from campaign_results import FAILURE, OPEN, flown, outcome
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.testing.campaign.campaign_file import read_campaign
from rpud_sim.testing.campaign.junit import campaign_junit
from rpud_sim.testing.campaign.outcome import (
    SYSTEM,
    outcome_from_dict,
)
from rpud_sim.testing.campaign.page import campaign_page
from rpud_sim.testing.campaign.store import CampaignStore
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

EXAMPLE = Path(__file__).resolve().parents[3] / "config" / "campaign.yaml"


@pytest.fixture(scope="module")
def campaign():
    return read_campaign(EXAMPLE)


def test_a_requirement_fails_in_the_scenario_where_a_run_breaks_it(campaign):
    broken = next(run for run in campaign.runs if run.scenario.name == "jammed")

    def change(run):
        return {"judged": {"force": FAILURE}} if run is broken else {}

    results = flown(campaign, change)
    (requirement,) = [each for each in results.requirements if each.outcome == FAILED]
    assert requirement.identifier == "SAFE-1"
    cell = requirement.cells["jammed"]
    assert (cell.outcome, cell.margin, cell.unit, cell.reaction_time) == (FAILED, -1.5, "N", 0.25)
    assert cell.worst.bag == f"{cell.worst.folder}/bag"
    assert requirement.cells["nominal"].outcome == PASSED
    assert not results.passed


def test_a_requirement_that_no_run_decides_has_not_passed(campaign):
    results = flown(campaign, lambda run: {"judged": {"drive off": OPEN}})
    assert {each.identifier: each.outcome for each in results.requirements}["SAFE-2"] == UNDECIDED
    assert not results.passed
    decided = flown(
        campaign,
        lambda run: {} if run.scenario.name == "jammed" else {"judged": {"drive off": OPEN}},
    )
    assert decided.passed


def test_a_requirement_without_an_expectation_has_not_passed(campaign):
    further = {**campaign.requirements, "SAFE-9": "It never melts."}
    results = flown(dataclasses.replace(campaign, requirements=further))
    assert results.requirements[-1].outcome == UNDECIDED
    assert "no expectation" in campaign_page(results)
    assert not results.passed


def test_a_system_under_test_that_dies_is_a_verdict_of_its_own(campaign):
    text = "supervisor.py ended with exit code 3, at 0.4 s of simulation time\n    out of memory"
    results = flown(campaign, lambda run: {"ending": "died", "text": text})
    assert results.requirements[0].identifier == SYSTEM
    assert results.requirements[0].outcome == FAILED
    failures = ElementTree.fromstring(campaign_junit(results)).findall(".//failure")
    assert len(failures) == len(campaign.runs)
    assert failures[0].attrib["type"] == "died"
    assert "out of memory" in failures[0].text
    assert "out of memory" in campaign_page(results)


def test_junit_counts_and_names_what_it_holds(campaign):
    results = flown(campaign, lambda run: {"judged": {"force": FAILURE, "drive off": OPEN}})
    root = ElementTree.fromstring(campaign_junit(results))
    for suite in root.findall("testsuite"):
        assert int(suite.attrib["tests"]) == len(suite.findall("testcase"))
        assert int(suite.attrib["failures"]) == len(suite.findall("testcase/failure")) == 1
        assert int(suite.attrib["skipped"]) == len(suite.findall("testcase/skipped")) == 1
    case = root.find(".//testcase[failure]")
    properties = {each.attrib["name"]: each.attrib["value"] for each in case.iter("property")}
    assert case.attrib["classname"] == properties["requirement"] == "SAFE-1"
    assert properties["margin"] == "-1.5 N"
    assert properties["bag"].endswith("/bag")


def test_the_page_escapes_names_and_links_to_bags(campaign):
    named = dataclasses.replace(campaign, name="<script>alert(1)</script>")
    page = campaign_page(flown(named))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert 'href="runs/0001_nominal' in page


def test_results_are_json_without_infinity(campaign):
    text = json.dumps(flown(campaign).to_dict(), allow_nan=False)
    assert json.loads(text)["passed"] is True


@settings(max_examples=20)
@given(wall_time=st.floats(0.0, 1e6), text=st.text())
def test_a_digest_has_no_wall_time_and_no_output(campaign, wall_time, text):
    one = outcome(campaign, ending="died", text="supervisor.py ended")
    other = outcome(campaign, ending="died", text=text, wall_time=wall_time)
    assert one.digest == other.digest


def test_a_digest_has_verdicts_and_everything_that_was_published(campaign):
    different = [
        outcome(campaign),
        outcome(campaign, record="abd"),
        outcome(campaign, judged={"force": FAILURE}),
        outcome(campaign, ending="late"),
        outcome(campaign, reached=5.9),
    ]
    assert len({each.digest for each in different}) == len(different)


def test_repetitions_with_different_results_are_reported(campaign):
    twice = campaign.repeated(2)
    same = flown(twice)
    assert same.repeatable
    assert len(same.digests) == len(campaign.runs)
    other = flown(twice, lambda run: {"record": str(run.repetition)})
    assert not other.repeatable
    assert all(len(digests) == 2 for digests in other.digests.values())


def test_a_run_is_kept_until_something_changes_on_which_it_depends(campaign, tmp_path):
    run = campaign.runs[0]
    store = CampaignStore(tmp_path, campaign)
    (store.folder(run) / "bag").mkdir(parents=True)
    assert store.outcome(run) is None
    kept = outcome(campaign, of=store.digest(run))
    store.add(run, kept)
    assert store.outcome(run) == kept == outcome_from_dict(json.loads(json.dumps(kept.to_dict())))
    system = campaign.system
    changed = [
        dataclasses.replace(campaign, expectations=campaign.expectations[1:]),
        dataclasses.replace(campaign, system=dataclasses.replace(system, files={"a": "b"})),
        dataclasses.replace(campaign, system=dataclasses.replace(system, period=0.2)),
    ]
    assert [CampaignStore(tmp_path, each).outcome(run) for each in changed] == [None] * 3
    other = dataclasses.replace(run, setup=dataclasses.replace(run.setup, seed=99))
    assert store.digest(other) != store.digest(run)
    store.add(run, outcome(campaign, of=store.digest(run), ending="broken"))
    assert store.outcome(run) is None
