"""A short campaign, and made-up results: all passed, except those that are given."""

from pathlib import Path

from rpud_sim.testing.campaign_results import FlownRun, results_of
from rpud_sim.testing.campaign_runs import COMPLETED, outcome_of
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

SUPERVISORS = Path(__file__).resolve().parent / "testing"
CAMPAIGN = f"""\
system:
  command: python supervisor.py works --ros-args -r __ns:=/rpud
  folder: {SUPERVISORS}
  answers: [supervisor/heartbeat]
  hears: [reacting_force]
  answer_timeout: 60.0
duration: 0.3
scenarios:
  calm: {{}}
  jammed: {{faults: [{{kind: free_mass_jammed, onset: 0.1}}]}}
expectations:
  - name: force
    requirement: SAFE-1
    expect: {{always: reacting_force.force < 500 N}}
  - name: after a jam
    requirement: SAFE-2
    expect:
      after: {{onset: free_mass_jammed}}
      expect: {{eventually: reacting_force.force >= 0 N}}
"""

FAILURE = (FAILED, -1.5, "N", 4.5, None, "broken at 4.5 s")
OPEN = (UNDECIDED, None, "", None, None, "the event of after never came")
_HELD = (PASSED, 2.0, "N", 3.0, 0.25, "held at 3 s")


def outcome(campaign, judged=None, ending=COMPLETED, text=""):
    """Return an outcome in which every expectation passed but those that are given."""
    verdicts = [
        Verdict(each.name, each.requirement, *(judged or {}).get(each.name, _HELD))
        for each in campaign.expectations
    ]
    return outcome_of(ending, 6.0, text, verdicts)


def flown(campaign, change=lambda run: {}):
    """Return the results of all runs, with changes of their outcomes."""
    return results_of(
        campaign,
        [
            FlownRun(run, outcome(campaign, **change(run)), 1.0, f"{run.name}/bag")
            for run in campaign.runs
        ],
    )
