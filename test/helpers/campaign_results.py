"""A short campaign, and made-up results: all passed, except those that are given."""

from pathlib import Path

from rpud_sim.testing.campaign_runs import COMPLETED, CampaignResults, recorded_attempt
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

SUPERVISORS = Path(__file__).resolve().parent
CAMPAIGN = f"""\
system:
  command: python supervisor.py works --ros-args -r __ns:=/rpud
  folder: {SUPERVISORS}
  answers: [supervisor/heartbeat]
  subscribes_to: [reacting_force]
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

FAILURE = (FAILED, -1.5, "N", 4.5, None, "reacting_force.force was 501.5 N at 4.5 s")
OPEN = (UNDECIDED, None, "", None, None, "the event of after never came: onset(free_mass_jammed)")
_HELD = (PASSED, 2.0, "N", 3.0, 0.25, "held at 3 s")


def attempt(campaign, change=lambda run: {}):
    """Return the results of all runs, in which every expectation passed but those that change."""

    def run_once(run, judged=None, ending=COMPLETED, text=""):
        verdicts = [
            Verdict(each.name, each.requirement, *(judged or {}).get(each.name, _HELD))
            for each in campaign.expectations
        ]
        made = recorded_attempt(run, ending, 6.0, text, verdicts)
        return made._replace(wall_time=1.0, bag=f"{run.name}/bag")

    return CampaignResults(campaign, [run_once(run, **change(run)) for run in campaign.runs])
