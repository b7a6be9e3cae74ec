"""Flight of one run of a campaign beside the system under test, and its result."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

from rpud_sim.testing.campaign_file import CampaignRun, CampaignSystem
from rpud_sim.testing.drill import Drill
from rpud_sim.testing.errors import DrillError, ExpectationFailedError, SystemUnderTestError
from rpud_sim.testing.expectations import verdict_line
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


class FlownRun(NamedTuple):
    """Run of a campaign, how it ended, and the verdicts on it."""

    run: CampaignRun
    ending: str  # one of ``ENDINGS``
    reached: float  # simulation time at its end [s]
    text: str  # why it ended early, with the last lines of output; empty if it is completed
    verdicts: tuple[Verdict, ...]  # on the system under test, and on each expectation
    wall_time: float = 0.0  # that it took [s]
    bag: str = ""  # path of its bag, relative to the campaign's page; empty for none
    report: str = ""  # path of its report page, likewise

    @property
    def failures(self) -> list[str]:
        """Reason of each failed verdict."""
        return [
            self.text if verdict.name == SYSTEM else verdict_line(verdict)
            for verdict in self.verdicts
            if verdict.outcome == FAILED
        ]

    def to_dict(self) -> dict[str, Any]:
        return {
            "run": self.run.name,
            "scenario": self.run.scenario,
            "faults": list(self.run.faults),
            "parameters": dict(self.run.parameters),
            "seed": self.run.setup.seed,
            **{name: getattr(self, name) for name in self._fields[1:]},
            "verdicts": [dataclasses.asdict(verdict) for verdict in self.verdicts],
        }


def flown_run(
    run: CampaignRun, ending: str, reached: float, text: str, verdicts: Sequence[Verdict] = ()
) -> FlownRun:
    """Return a run with the verdict on the system under test itself."""
    outcome = {COMPLETED: PASSED, BROKEN: UNDECIDED}.get(ending, FAILED)
    reason = text.partition("\n")[0] or ENDINGS[ending]
    system = Verdict(SYSTEM, "", outcome, at=reached, text=reason)
    return FlownRun(run, ending, reached, text, (system, *verdicts))


def fly(
    drill: Drill, run: CampaignRun, system: CampaignSystem, expectations: Sequence[Expectation]
) -> FlownRun:
    """Step the drill through a run beside the system under test, and judge what was published."""
    topics = {topic for each in expectations for topic in each.topics}
    ending, text = COMPLETED, ""
    try:
        _step_through(drill, run.duration, system, topics)
    except SystemUnderTestError as error:
        ending, text = error.kind, str(error)
        if not drill.alive:
            raise DrillError(f"the drill has ended; its last lines:\n{drill.output}") from error
        if _missing(drill, topics):  # it ended before there was something to judge
            return flown_run(run, ending, drill.time, text)
    try:
        verdicts = drill.expect(*expectations)
    except ExpectationFailedError as failed:
        verdicts = failed.verdicts
    if ending != COMPLETED:
        verdicts = tuple(_cut_short(each, drill.time) for each in verdicts)
    return flown_run(run, ending, drill.time, text, verdicts)


def _step_through(drill: Drill, duration: float, system: CampaignSystem, topics: set[str]) -> None:
    deadline = time.monotonic() + system.run_timeout
    drill.with_answers(*system.answers, period=system.period, timeout=system.answer_timeout)
    drill.start(
        *system.words,
        name=system.name,
        hears=system.hears,
        ready=system.ready or None,
        timeout=system.start_timeout,
    )
    for topic in _missing(drill, topics):
        drill.listen(topic)
    for number in range(1, math.ceil(duration / system.period - 1e-9) + 1):
        if time.monotonic() > deadline:
            reached = f"{drill.time:.3f} s of simulation time"
            text = f"the run has reached {reached} after {system.run_timeout:g} s"
            raise SystemUnderTestError(system.name, "late", text)
        drill.step(min(number * system.period, duration) - drill.time)


def _missing(drill: Drill, topics: set[str]) -> list[str]:
    """Return the topics of expectations that are not listened to yet."""
    heard = [name.removeprefix(f"{drill.namespace}/") for name in drill.heard]
    return sorted(topics - {*heard, *drill.heard})


def _cut_short(verdict: Verdict, reached: float) -> Verdict:
    """Return the verdict on a run that ended early: what has held until then proves nothing."""
    if not verdict.passed:
        return verdict
    text = f"the run ended early, at {reached:.9g} s; until then: {verdict.text}"
    return dataclasses.replace(verdict, outcome=UNDECIDED, margin=None, unit="", text=text)
