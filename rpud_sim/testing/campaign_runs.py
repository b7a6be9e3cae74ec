"""Runs of a campaign: attempts beside the system under test, and what they report together.

The results are each requirement under each scenario, as table, JSON and page.
"""

from __future__ import annotations

import dataclasses
import math
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from rpud_sim.foundation.terminal import printable, table
from rpud_sim.pages.frame import render_page
from rpud_sim.testing.campaign_file import Campaign, CampaignRun, CampaignSystem, read_campaign
from rpud_sim.testing.drill import LockstepDrill
from rpud_sim.testing.errors import (
    DrillError,
    ExpectationFailedError,
    ExpectationUndecidedError,
    SystemUnderTestError,
)
from rpud_sim.testing.expectations import verdict_line
from rpud_sim.verdicts import Expectation, Verdict
from rpud_sim.verdicts.reasons import NO_EVENT
from rpud_sim.verdicts.verdict import FAILED, OUTCOMES, PASSED, UNDECIDED

COMPLETED, BROKEN = "completed", "broken"
ENDINGS = {
    COMPLETED: "the system under test has answered every step",
    "died": "the system under test ended by itself",
    "silent": "the system under test does not answer",
    "late": "the system under test answers too late",
    BROKEN: "drill or middleware failed: the run shows nothing about the system under test",
}
# Name of the verdict of every run on whether the system under test has answered to the end.
SYSTEM = "system under test"


class RecordedAttempt(NamedTuple):
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


def recorded_attempt(
    run: CampaignRun, ending: str, reached: float, text: str, verdicts: Sequence[Verdict] = ()
) -> RecordedAttempt:
    """Return a run with the verdict on the system under test itself."""
    outcome = {COMPLETED: PASSED, BROKEN: UNDECIDED}.get(ending, FAILED)
    reason = text.partition("\n")[0] or ENDINGS[ending]
    system = Verdict(SYSTEM, "", outcome, at=reached, text=reason)
    return RecordedAttempt(run, ending, reached, text, (system, *verdicts))


def run_once(
    drill: LockstepDrill,
    run: CampaignRun,
    system: CampaignSystem,
    expectations: Sequence[Expectation],
) -> RecordedAttempt:
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
            return recorded_attempt(run, ending, drill.time, text)
    try:
        verdicts = drill.expect(*expectations)
    except (ExpectationFailedError, ExpectationUndecidedError) as error:
        verdicts = error.verdicts
    if ending != COMPLETED:
        verdicts = tuple(_cut_short(each, drill.time) for each in verdicts)
    return recorded_attempt(run, ending, drill.time, text, verdicts)


def _step_through(
    drill: LockstepDrill, duration: float, system: CampaignSystem, topics: set[str]
) -> None:
    deadline = time.monotonic() + system.run_timeout
    drill.with_answers(*system.answers, period=system.period, timeout=system.answer_timeout)
    drill.start(
        *system.words,
        name=system.name,
        subscribes_to=system.subscribes_to,
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


def _missing(drill: LockstepDrill, topics: set[str]) -> list[str]:
    """Return the topics of expectations that are not listened to yet."""
    heard = [name.removeprefix(f"{drill.namespace}/") for name in drill.heard]
    return sorted(topics - {*heard, *drill.heard})


def _cut_short(verdict: Verdict, reached: float) -> Verdict:
    """Return the verdict on a run that ended early: what has held until then proves nothing."""
    if not verdict.passed:
        return verdict
    text = f"the run ended early, at {reached:.9g} s; until then: {verdict.text}"
    return dataclasses.replace(verdict, outcome=UNDECIDED, margin=None, unit="", text=text)


_BODY = """
<style>
 b { text-transform: capitalize; }
 .headline { font-size: 1.4em; }
 td a, p a { display: inline-block; min-width: 24px; line-height: 24px; }
 td:has(> .failed) { background: color-mix(in srgb, var(--fault) 8%, var(--paper)); }
 td:has(> .passed) { background: color-mix(in srgb, var(--series2) 6%, var(--paper)); }
 b.failed { color: var(--fault); }
 b.passed { color: var(--series2); } b.undecided { color: var(--muted); }
 pre { background: var(--panel); padding: .6em; overflow-x: auto; }
</style>
<p class="headline"><b class="{{ verdict }}">{{ verdict }}</b>: {{ counts }} of
{{ matrix | length - 1 }} requirements, in {{ runs | length }} runs</p>
<p>System under test: {{ system }}</p>
<h2>Requirements by faults</h2>
<p>Each field has the worst verdict, the least margin, the longest time to react, and the run with
the worst verdict. The margin is the distance from the value to its limit: it is negative if the
requirement failed. A verdict is undecided if the fault of which it speaks does not occur, or if the
run ends before.</p>
{{ table(matrix[0], matrix[1:], false, "Requirements by scenarios and their faults") }}
{% if failures %}
<h2>What failed</h2>
{% for name, links, text in failures %}
<h3>{{ name }}</h3>
<p>{{ links }}</p>
<pre tabindex="0" role="region" aria-label="Reasons">{% for line in text %}{{ line }}
{% endfor %}</pre>
{% endfor %}
{% endif %}
<h2>Runs</h2>
{{ table(heading, runs, false, "All runs") }}
"""
_MOST_FAILURES = 100  # in full: the table of runs has all


class MatrixCell(NamedTuple):
    """Verdicts on one requirement in some runs."""

    outcome: str  # failed if one failed, passed if one passed, undecided otherwise
    margin: float | None  # the least one; None without any, or in two units
    unit: str  # of the margin
    reaction_time: float | None  # the longest one [s]; None without any
    worst: RecordedAttempt  # run that shows the worst verdict
    text: str  # of that verdict

    def __str__(self) -> str:
        margin = "" if self.margin is None else f" {self.margin:.3g} {self.unit}".rstrip()
        reaction = "" if self.reaction_time is None else f" in {self.reaction_time:.2f} s"
        return f"{self.outcome}{margin}{reaction}"


class CampaignResults:
    """Results of those runs of a campaign that were made, in the order of the campaign."""

    def __init__(self, campaign: Campaign, runs: Sequence[RecordedAttempt]) -> None:
        self.campaign = campaign
        self.runs = tuple(runs)
        self.scenarios = {attempt.run.scenario: attempt.run.faults for attempt in runs}
        # Names of the expectations of each requirement: the system under test itself, then names of
        # the campaign; an expectation without a requirement is one.
        self.requirements = {SYSTEM: [SYSTEM], **{name: [] for name in campaign.requirements}}
        for each in campaign.expectations:
            self.requirements.setdefault(each.requirement or each.name, []).append(each.name)
        # By requirement and scenario, the empty name for all; none where it has no verdict.
        self.cells: dict[tuple[str, str], MatrixCell] = {}
        for name, expectations in self.requirements.items():
            for scenario in ("", *self.scenarios):
                chosen = [attempt for attempt in runs if scenario in ("", attempt.run.scenario)]
                pairs = [(verdict, attempt) for attempt in chosen for verdict in attempt.verdicts]
                if found := [pair for pair in pairs if pair[0].name in expectations]:
                    self.cells[name, scenario] = _cell(found)
        whole = {name: self.cells.get((name, "")) for name in self.requirements}
        # Outcome of each requirement over all runs.
        self.outcomes = {name: cell.outcome if cell else UNDECIDED for name, cell in whole.items()}
        self.counts = {each: [*self.outcomes.values()].count(each) for each in OUTCOMES}
        self.sums = ", ".join(f"{count} {outcome}" for outcome, count in self.counts.items())
        # Requirements that no run decides, with the reason of one verdict.
        self.undecided = {
            name: cell.text if cell else "no run has a verdict on it"
            for name, cell in whole.items()
            if self.outcomes[name] == UNDECIDED
        }

    @property
    def verdict(self) -> str:
        """Outcome of the campaign: failed if a requirement is, passed if all are."""
        order = (FAILED, UNDECIDED, PASSED)
        return min(self.outcomes.values(), key=order.index, default=UNDECIDED)

    def lines(self) -> list[str]:
        """Return the matrix of requirements by scenarios as lines of a table."""
        head = ("requirement", "verdict", *self.scenarios)
        rows = [
            (name, outcome, *(self.cells.get((name, each)) for each in self.scenarios))
            for name, outcome in self.outcomes.items()
        ]
        return [*table(head, rows, left=len(head)), "", f"requirements: {self.sums}"]

    def to_dict(self) -> dict[str, Any]:
        return {
            "campaign": self.campaign.name,
            "counts": self.counts,
            "requirements": self.outcomes,
            "runs": [attempt.to_dict() for attempt in self.runs],
        }


def results_from_reports(
    file: Path, reports: Sequence[Mapping[str, Any]], place: Path
) -> CampaignResults:
    """Return the results of what pytest has reported of runs; ``place`` is the page's folder."""
    campaign = read_campaign(file)
    found = {report["name"]: report for report in reports}
    runs = []
    for run in campaign.runs:
        if report := found.get(run.name):
            ended = report["ending"], report["reached"], report["text"]
            verdicts = tuple(Verdict(**each) for each in report["verdicts"])
            files = [report.get(name, "") for name in ("rpud_bag", "rpud_report")]
            relative = [each and Path(each).relative_to(place).as_posix() for each in files]
            runs.append(RecordedAttempt(run, *ended, verdicts, report["wall_time"], *relative))
    return CampaignResults(campaign, runs)


def _cell(found: Sequence[tuple[Verdict, RecordedAttempt]]) -> MatrixCell:
    verdicts = [verdict for verdict, _ in found]
    outcomes = [verdict.outcome for verdict in verdicts]
    outcome = next((each for each in (FAILED, PASSED) if each in outcomes), UNDECIDED)
    margins = [(each.margin, each.unit) for each in verdicts if each.margin is not None]
    one_unit = len({unit for _, unit in margins}) == 1
    margin, unit = min(margins) if one_unit else (None, "")
    reactions = [each.reaction_time for each in verdicts if each.reaction_time is not None]

    def badness(entry: tuple[Verdict, RecordedAttempt]) -> tuple[int, float]:
        verdict, _ = entry
        margin = float("inf") if verdict.margin is None else verdict.margin
        return (FAILED, UNDECIDED, PASSED).index(verdict.outcome), margin

    worst, attempt = min(found, key=badness)
    return MatrixCell(outcome, margin, unit, max(reactions, default=None), attempt, worst.text)


def campaign_page(results: CampaignResults) -> str:
    campaign, names = results.campaign, [each.name for each in results.campaign.expectations]
    faults = [", ".join(each).replace("_", " ") for each in results.scenarios.values()]
    matrix: list[list[Any]] = [
        [
            "requirement",
            "verdict",
            *map(_below, results.scenarios, (each or "no fault" for each in faults)),
        ]
    ]
    for name, expectations in results.requirements.items():
        text = campaign.requirements.get(name, ", ".join(expectations))
        cells = [results.cells.get((name, each)) for each in ("", *results.scenarios)]
        matrix.append([_below(name, text), *map(_field, cells)])
    runs = []
    for number, attempt in enumerate(results.runs, 1):
        ending = attempt.ending if attempt.ending == COMPLETED else ENDINGS[attempt.ending]
        judged = {each.name: str(_cell([(each, attempt)])) for each in attempt.verdicts}
        times = f"{attempt.reached:.3f}", f"{attempt.wall_time:.2f}"
        row = [judged.get(name, "-") for name in names]
        runs.append([number, attempt.run.name, ending, *times, *row, _links(attempt)])
    failed = [attempt for attempt in results.runs if attempt.failures]
    return render_page(
        _BODY,
        campaign.name,
        system=" ".join(campaign.system.words),
        verdict=results.verdict,
        counts=results.sums,
        matrix=matrix,
        failures=[
            (attempt.run.name, _links(attempt), "\n".join(attempt.failures).splitlines())
            for attempt in failed[:_MOST_FAILURES]
        ],
        heading=["number", "run", "ending", "simulated [s]", "real [s]", *names, "artefacts"],
        runs=runs,
    )


def _below(name: str, text: str) -> Markup:
    return Markup('{}<br><span class="none">{}</span>').format(printable(name), printable(text))


def _field(cell: MatrixCell | None) -> Markup:
    if cell is None:
        return Markup("<b>no verdict</b>")
    if cell.outcome == UNDECIDED and cell.text.startswith(NO_EVENT):
        event = cell.text.removeprefix(NO_EVENT).lstrip(": ")
        event = re.sub(r"^(?:onset|cleared)\((.*)\)$", r"\1", event).replace("_", " ")
        return Markup('<span class="none">n/a: no {} here</span>').format(printable(event))
    rest = cell.text if cell.outcome == UNDECIDED else str(cell).removeprefix(cell.outcome)
    return Markup('<b class="{0}">{0}</b> {1}<br>{2}').format(
        cell.outcome, printable(rest), _links(cell.worst)
    )


def _links(attempt: RecordedAttempt) -> Markup:
    files = {"report": attempt.report, "bag": attempt.bag}
    link = Markup('<a href="{}">{}</a> ')
    return Markup("").join(link.format(quote(p), name) for name, p in files.items() if p)
