"""Runs of a campaign: their flights, their outcomes, and the tests that pytest sees in them."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.campaign_file import Campaign, CampaignRun, CampaignSystem, read_campaign
from rpud_sim.testing.drill import Drill
from rpud_sim.testing.errors import (
    DrillError,
    ExpectationFailedError,
    LostMessagesError,
    SystemUnderTestError,
)
from rpud_sim.testing.expectations import verdict_line
from rpud_sim.testing.item_drills import give_back_drills, take_drill
from rpud_sim.verdicts import Expectation, Verdict
from rpud_sim.verdicts.verdict import FAILED, PASSED, UNDECIDED

COMPLETED, BROKEN = "completed", "broken"
ENDINGS = {
    COMPLETED: "the system under test has answered every step",
    "died": "the system under test ended by itself",
    "silent": "the system under test does not answer",
    "late": "the system under test answers too late",
    BROKEN: "drill or middleware failed: the run says nothing about the system under test",
}
# Name of the verdict of every run on whether the system under test has answered to the end.
SYSTEM = "system under test"


@dataclasses.dataclass(frozen=True)
class RunOutcome:
    """Ending of a run, and the verdicts on it."""

    ending: str  # one of ``ENDINGS``
    reached: float  # simulation time at its end [s]
    text: str  # why it ended early, with the last lines of output; empty if it is completed
    verdicts: tuple[Verdict, ...]  # on the system under test, and on each expectation

    @property
    def failures(self) -> list[str]:
        """Reason of each failed verdict."""
        return [
            self.text if verdict.name == SYSTEM else verdict_line(verdict)
            for verdict in self.verdicts
            if verdict.outcome == FAILED
        ]

    def to_json(self) -> str:
        return json.dumps(dataclasses.asdict(self))


def outcome_from_json(text: str) -> RunOutcome:
    content = json.loads(text)
    verdicts = tuple(Verdict(**each) for each in content.pop("verdicts"))
    return RunOutcome(**content, verdicts=verdicts)


def outcome_of(
    ending: str, reached: float, text: str, verdicts: Sequence[Verdict] = ()
) -> RunOutcome:
    """Return an outcome with the verdict on the system under test itself."""
    outcome = {COMPLETED: PASSED, BROKEN: UNDECIDED}.get(ending, FAILED)
    reason = text.partition("\n")[0] or ENDINGS[ending]
    system = Verdict(SYSTEM, "", outcome, None, "", reached, None, reason)
    return RunOutcome(ending, reached, text, (system, *verdicts))


def fly(
    drill: Drill, run: CampaignRun, system: CampaignSystem, expectations: Sequence[Expectation]
) -> RunOutcome:
    """Step the drill through a run beside the system under test, and judge what was published."""
    ending, text = _step_through(drill, run, system, expectations)
    if ending == COMPLETED:
        return outcome_of(ending, drill.time, text, _judge(drill, expectations))
    if not drill.alive:
        raise DrillError(f"the drill has ended; its last lines:\n{drill.output}")
    # Without all their topics, nothing was published on which expectations could be judged.
    listening = not _missing_topics(drill, expectations)
    verdicts = _judge(drill, expectations) if listening else ()
    reached = drill.time
    return outcome_of(ending, reached, text, [_cut_short(each, reached) for each in verdicts])


def _step_through(
    drill: Drill, run: CampaignRun, system: CampaignSystem, expectations: Sequence[Expectation]
) -> tuple[str, str]:
    """Return the ending, and the reason if the run ended early."""
    deadline = time.monotonic() + system.run_timeout
    drill.with_answers(*system.answers, period=system.period, timeout=system.answer_timeout)
    try:
        drill.start(
            *system.command,
            name=system.name,
            hears=system.hears,
            ready=system.ready or None,
            timeout=system.start_timeout,
        )
        for topic in _missing_topics(drill, expectations):
            drill.listen(topic)
        duration = run.scenario.duration
        for number in range(1, math.ceil(duration / system.period - 1e-9) + 1):
            if time.monotonic() > deadline:
                return "late", (
                    f"the run has reached {drill.time:.3f} s of simulation time after "
                    f"{system.run_timeout:g} s"
                )
            drill.step(min(number * system.period, duration) - drill.time)
    except SystemUnderTestError as error:
        return error.kind, str(error)
    return COMPLETED, ""


def _missing_topics(drill: Drill, expectations: Sequence[Expectation]) -> list[str]:
    """Return the topics of expectations that are not listened to yet."""
    heard = [name.removeprefix(f"{drill.namespace}/") for name in drill.heard]
    topics = {topic for expectation in expectations for topic in expectation.topics}
    return sorted(topics - {*heard, *drill.heard})


def _judge(drill: Drill, expectations: Sequence[Expectation]) -> tuple[Verdict, ...]:
    try:
        return drill.expect(*expectations)
    except ExpectationFailedError as error:
        return error.verdicts


def _cut_short(verdict: Verdict, reached: float) -> Verdict:
    """Return the verdict on a run that ended early: what has held until then proves nothing."""
    if not verdict.passed:
        return verdict
    text = f"the run ended early, at {reached:.9g} s; until then: {verdict.text}"
    return dataclasses.replace(verdict, outcome=UNDECIDED, margin=None, unit="", text=text)


class RunFailedError(AssertionError):
    """Run of a campaign in which a verdict failed."""


class CampaignFile(pytest.File):
    """Campaign file: an item for each run."""

    def collect(self) -> Iterator[CampaignItem]:
        try:
            campaign = read_campaign(self.path)
        except ParameterError as error:
            raise self.CollectError(str(error)) from None
        for run in campaign.runs:
            yield CampaignItem.from_parent(self, name=run.name, run=run, campaign=campaign)


class CampaignItem(pytest.Item):
    """Run of a campaign."""

    def __init__(self, run: CampaignRun, campaign: Campaign, **options: Any) -> None:
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
        give_back_drills(self)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the reasons without a traceback into this package."""
        if isinstance(excinfo.value, AssertionError | DrillError | ParameterError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, 0, self.name
