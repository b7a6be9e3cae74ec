"""One run: a system under test that dies, hangs or answers late gives a verdict, and no hang."""

from pathlib import Path

import pytest
from support import extended

from rpud_sim.testing.campaign_file import read_campaign
from rpud_sim.testing.campaign_runs import run_once
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

SUPERVISORS = Path(__file__).resolve().parents[2] / "helpers"  # with the plugin's node under test
CAMPAIGN = """\
system:
  {system}
  folder: {folder}
  answers: [supervisor/heartbeat]
  subscribes_to: [reacting_force]
  answer_timeout: {patience}
  run_timeout: {limit}
duration: 1.0
scenarios:
  jammed: {{faults: [{{kind: free_mass_jammed, onset: 0.5}}]}}
expectations:
  - name: force
    requirement: SAFE-1
    expect: {{always: reacting_force.force < 500 N}}
  - name: heartbeat
    requirement: LIVE-1
    expect: {{count: {{message: /rpud/supervisor/heartbeat}}, is: '>= 10'}}
"""


@pytest.fixture
def attempt(pool, tmp_path):
    drills = []

    def start(how="works", patience=60.0, limit=600.0, launch=None):
        file = tmp_path / "campaign.yaml"
        command = f"command: python supervisor.py {how} --ros-args -r __ns:=/rpud"
        if launch:
            command = f"launch: {launch}"
        file.write_text(
            CAMPAIGN.format(system=command, folder=SUPERVISORS, patience=patience, limit=limit)
        )
        campaign = read_campaign(file)
        drills.append(pool.take(campaign.runs[0].setup, campaign.system.place))
        return run_once(drills[-1], campaign.runs[0], campaign.system, campaign.expectations)

    yield start
    for drill in drills:
        pool.give_back(drill)


def outcomes(outcome):
    return {verdict.name: verdict.outcome for verdict in outcome.verdicts}


def test_a_system_that_dies_is_a_verdict_with_its_last_lines(attempt):
    outcome = attempt("dies")
    assert outcome.ending == "died"
    assert "exit code 3" in outcome.text
    assert "the supervisor dies" in outcome.text
    assert outcome.reached == 0.4
    # What held until then proves nothing.
    assert outcomes(outcome) == {
        "system under test": FAILED,
        "force": UNDECIDED,
        "heartbeat": outcomes(outcome)["heartbeat"],
    }
    assert outcomes(outcome)["heartbeat"] != PASSED


@pytest.mark.parametrize(
    ("how", "ending", "text"),
    [
        ("hangs", "silent", "the supervisor hangs"),
        extended("lags", "late", "whose last answer is for 0.300 s"),
    ],
)
def test_a_system_that_does_not_answer_in_time_is_a_verdict(attempt, how, ending, text):
    outcome = attempt(how, patience=2.0)
    assert outcome.ending == ending
    assert "no answer for 0.400 s of simulation time on " in outcome.text
    assert " within 2 s" in outcome.text
    assert text in outcome.text
    assert outcomes(outcome)["system under test"] == FAILED


def test_a_run_that_takes_too_long_ends_as_late(attempt):
    outcome = attempt("works", limit=1e-3)
    assert outcome.ending == "late"
    assert "after 0.001 s" in outcome.text
