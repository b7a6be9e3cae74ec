"""Made-up results of campaigns: every expectation passed, except those that are given."""

from rpud_sim.testing.campaign.outcome import COMPLETED, Outcome, system_verdict
from rpud_sim.testing.campaign.results import FlownRun, results_of
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED


def outcome(campaign, judged=None, ending=COMPLETED, text="", **values):
    """Return an outcome in which every expectation passed but those that are given."""
    verdicts = [
        Verdict(each.name, each.requirement, PASSED, 2.0, "N", 3.0, 0.25, "held at 3 s")
        if each.name not in (judged or {})
        else Verdict(each.name, each.requirement, *judged[each.name])
        for each in campaign.expectations
    ]
    known = {"of": "", "reached": 6.0, "record": "abc", "wall_time": 1.0, "bag": "bag", **values}
    system = system_verdict(ending, 6.0, text)
    return Outcome(ending=ending, text=text, verdicts=(system, *verdicts), **known)


def flown(campaign, change=lambda run: {}):
    return results_of(
        campaign,
        [
            FlownRun(run, outcome(campaign, **change(run)), f"runs/{run.folder}")
            for run in campaign.runs
        ],
    )


FAILURE = (FAILED, -1.5, "N", 4.5, None, "broken at 4.5 s")
OPEN = (UNDECIDED, None, "", None, None, "the event of after never came")
