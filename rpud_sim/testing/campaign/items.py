"""Campaigns as pytest sees them: a file with one item for each run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.campaign.campaign_file import read_campaign
from rpud_sim.testing.campaign.outcome import BROKEN, RunOutcome, fly, outcome_of
from rpud_sim.testing.campaign.specification import CampaignRun, CampaignSpecification
from rpud_sim.testing.errors import DrillError, LostMessagesError
from rpud_sim.testing.plugin import give_back_drills, take_drill


class RunFailedError(AssertionError):
    """Run of a campaign in which a verdict failed."""


class CampaignFile(pytest.File):
    """Campaign file."""

    def collect(self) -> Iterator[CampaignItem]:
        """Return an item for each run."""
        try:
            campaign = read_campaign(self.path)
        except ParameterError as error:
            raise self.CollectError(str(error)) from None
        for run in campaign.runs:
            yield CampaignItem.from_parent(self, name=run.name, run=run, campaign=campaign)


class CampaignItem(pytest.Item):
    """Run of a campaign."""

    def __init__(self, run: CampaignRun, campaign: CampaignSpecification, **options: Any) -> None:
        super().__init__(**options)
        self._run, self._campaign = run, campaign
        self.rpud_outcome: RunOutcome | None = None

    def runtest(self) -> None:
        """Fly the run; a failed verdict fails the test.

        An undecided one may be decided by another run; see ``CampaignSession``.
        """
        system = self._campaign.system
        try:
            drill = take_drill(self, self._run.setup, system.folder)
            self.rpud_outcome = fly(drill, self._run, system, self._campaign.expectations)
        except (DrillError, LostMessagesError, ParameterError) as error:
            self.rpud_outcome = outcome_of(BROKEN, 0.0, str(error))
            raise
        if failures := self.rpud_outcome.failures:
            raise RunFailedError("\n".join(failures))

    def teardown(self) -> None:
        """Keep the drill for the next test."""
        give_back_drills(self)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the reasons without a traceback into this package."""
        if isinstance(excinfo.value, AssertionError | DrillError | ParameterError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Return the place and the name for reports."""
        return self.path, 0, self.name
