"""Folder of a campaign: a folder for each run, whose result appears when it is complete."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.held_folder import held_folder
from rpud_sim.testing.campaign.outcome import BROKEN, Outcome, outcome_from_dict
from rpud_sim.testing.campaign.specification import Campaign, CampaignError, PlannedRun
from rpud_sim.testing.campaign.system_entry import program_words
from rpud_sim.verdicts.expectation_files import expectations_to_yaml

_RUNS = "runs"
_RESULT = "result.json"
_FORMAT = 1  # of the results; it grows when a run gives others


class CampaignStore:
    """Runs of a campaign in its folder.

    A run that has ended is kept as long as nothing changes on which it depends: the system under
    test, the scenario, the parameters, the seed, the expectations, and the versions.
    """

    def __init__(self, path: Path, campaign: Campaign) -> None:
        self.path = path
        self._common = _what_all_runs_are(campaign)

    def held(self) -> contextlib.AbstractContextManager[None]:
        """Create or open the folder, and lock it against other processes; see ``held_folder``.

        Raises:
            CampaignError: if it is locked or holds anything but a campaign.
            OSError: if it cannot be created.
        """
        return held_folder(self.path, {"campaign": _FORMAT}, "test", CampaignError)

    def folder(self, run: PlannedRun) -> Path:
        """Return the folder of a run."""
        return self.path / _RUNS / run.folder

    def digest(self, run: PlannedRun) -> str:
        """Return a digest of everything that a run depends on."""
        content = {
            **self._common,
            "scenario": run.setup.scenario,
            "parameters": dict(run.setup.parameters),
            "namespace": run.setup.namespace,
            "seed": run.setup.seed,
            "duration": run.scenario.duration,
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def outcome(self, run: PlannedRun) -> Outcome | None:
        """Return the outcome of a run that has ended; None if it has to be flown."""
        try:
            content = json.loads((self.folder(run) / _RESULT).read_text(encoding="utf-8"))
            outcome = outcome_from_dict(content)
        except (OSError, ValueError, LookupError, TypeError):
            return None
        same = outcome.of == self.digest(run) and outcome.ending != BROKEN
        whole = not outcome.bag or (self.folder(run) / outcome.bag).is_dir()
        return outcome if same and whole else None

    def add(self, run: PlannedRun, outcome: Outcome) -> None:
        """Keep the outcome of a run."""
        with whole_file(self.folder(run) / _RESULT) as unfinished:
            content = {"run": run.name, **outcome.to_dict()}
            unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _what_all_runs_are(campaign: Campaign) -> dict[str, Any]:
    system = campaign.system
    return {
        "format": _FORMAT,
        "versions": engine_versions(),
        "command": program_words(system.command),
        "files": dict(system.files),
        "answers": system.answers,
        "hears": system.hears,
        "ready": system.ready,
        "times": [
            system.period,
            system.answer_timeout,
            system.start_timeout,
            system.run_timeout,
        ],
        "expectations": expectations_to_yaml(campaign.expectations),
    }
