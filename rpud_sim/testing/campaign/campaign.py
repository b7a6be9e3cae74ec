"""Campaign from its plan to its results, in parallel and resumable."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.studies.processes import run_on_processes
from rpud_sim.testing.campaign.flight import Job, fly_in_worker
from rpud_sim.testing.campaign.junit import campaign_junit
from rpud_sim.testing.campaign.outcome import Outcome
from rpud_sim.testing.campaign.page import campaign_page
from rpud_sim.testing.campaign.results import FlownRun, Results, results_of
from rpud_sim.testing.campaign.specification import Campaign
from rpud_sim.testing.campaign.store import CampaignStore

RESULTS, JUNIT, PAGE = "results.json", "junit.xml", "index.html"
_GRACE = 20.0  # for a worker to end the drills and the systems that it has started [s]


def run_campaign(
    campaign: Campaign,
    out: Path,
    workers: int,
    again: bool = False,
    report: Callable[[int], object] = lambda runs: None,
) -> tuple[Results, int]:
    """Fly those runs of a campaign that have not ended yet, and write its results.

    Args:
        out: its folder; new, or left by an earlier call.
        workers: number of runs at the same time.
        again: whether to fly all runs, also those that have ended.
        report: called with the number of runs that have ended since its last call.

    Returns:
        the results, and the number of runs that this call has flown.

    Raises:
        CampaignError: if the folder holds anything else.
        WorkerError: if a run ends its worker.
        OSError: if a file cannot be written.
    """
    store = CampaignStore(out, campaign)
    with store.held():
        outcomes: dict[str, Outcome] = {}
        for run in campaign.runs:
            kept = None if again else store.outcome(run)
            if kept is not None:
                outcomes[run.folder] = kept
        kept_count = len(outcomes)
        report(kept_count)
        if kept_count < len(campaign.runs):
            jobs = list(_jobs(campaign, store, outcomes))
            done = run_on_processes(fly_in_worker, iter(jobs), min(workers, len(jobs)), _GRACE)
            with contextlib.closing(done):
                for job, outcome in done:
                    store.add(job.run, outcome)
                    outcomes[job.run.folder] = outcome
                    report(1)
        runs = [
            FlownRun(run, outcomes[run.folder], store.folder(run).relative_to(out).as_posix())
            for run in campaign.runs
        ]
        results = results_of(campaign, runs)
        _write(results, out)
    return results, len(campaign.runs) - kept_count


def _jobs(campaign: Campaign, store: CampaignStore, ended: Mapping[str, Outcome]) -> Iterator[Job]:
    for run in campaign.runs:
        if run.folder not in ended:
            yield Job(
                run.number,
                run,
                store.digest(run),
                campaign.system,
                campaign.expectations,
                store.folder(run),
            )


def _write(results: Results, out: Path) -> None:
    texts = {
        RESULTS: json.dumps(results.to_dict(), indent=2) + "\n",
        JUNIT: campaign_junit(results),
        PAGE: campaign_page(results),
    }
    for name, text in texts.items():
        with whole_file(out / name) as unfinished:
            unfinished.write_text(text, encoding="utf-8")
