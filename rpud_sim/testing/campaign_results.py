"""Results of a campaign: each requirement under each scenario, as table, JSON and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from markupsafe import Markup

from rpud_sim.foundation.terminal import printable, table
from rpud_sim.pages.frame import render_page
from rpud_sim.testing.campaign_file import Campaign, read_campaign
from rpud_sim.testing.campaign_runs import (
    COMPLETED,
    ENDINGS,
    SYSTEM,
    FlownRun,
)
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, OUTCOMES, PASSED, UNDECIDED

_BODY = """
<style>
 b { text-transform: capitalize; } b.failed { color: var(--fault); }
 b.passed { color: var(--series2); } b.undecided { color: var(--muted); }
 pre { background: var(--panel); padding: .6em; overflow-x: auto; }
</style>
<p>System under test: {{ system }}</p>
<p>Requirements: {{ counts }}; runs: {{ runs | length }}</p>
<h2>Requirements by faults</h2>
<p>Each field has the worst verdict, the least margin, the longest time to react, and the run with
the worst verdict. A verdict is undecided if the fault of which it speaks does not occur, or if the
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
    worst: FlownRun  # run that shows the worst verdict
    text: str  # of that verdict

    def __str__(self) -> str:
        margin = "" if self.margin is None else f" {self.margin:.3g} {self.unit}".rstrip()
        reaction = "" if self.reaction_time is None else f" in {self.reaction_time:.2f} s"
        return f"{self.outcome}{margin}{reaction}"


class CampaignResults:
    """Results of those runs of a campaign that were flown, in the order of the campaign."""

    def __init__(self, campaign: Campaign, runs: Sequence[FlownRun]) -> None:
        self.campaign = campaign
        self.runs = tuple(runs)
        self.scenarios = {flown.run.scenario: flown.run.faults for flown in runs}
        # Names of the expectations of each requirement: the system under test itself, then those of
        # the campaign; an expectation without a requirement is one.
        self.requirements = {SYSTEM: [SYSTEM], **{name: [] for name in campaign.requirements}}
        for each in campaign.expectations:
            self.requirements.setdefault(each.requirement or each.name, []).append(each.name)
        # By requirement and scenario, the empty name for all; none where it has no verdict.
        self.cells: dict[tuple[str, str], MatrixCell] = {}
        for name, expectations in self.requirements.items():
            for scenario in ("", *self.scenarios):
                found = [
                    (verdict, flown)
                    for flown in runs
                    if scenario in ("", flown.run.scenario)
                    for verdict in flown.verdicts
                    if verdict.name in expectations
                ]
                if found:
                    self.cells[name, scenario] = _cell(found)

    @property
    def outcomes(self) -> dict[str, str]:
        """Outcome of each requirement over all runs."""
        found = {name: self.cells.get((name, "")) for name in self.requirements}
        return {name: cell.outcome if cell else UNDECIDED for name, cell in found.items()}

    @property
    def counts(self) -> dict[str, int]:
        return {each: [*self.outcomes.values()].count(each) for each in OUTCOMES}

    @property
    def undecided(self) -> dict[str, str]:
        """Requirements that no run decides, with the reason of one verdict."""
        names = [name for name, outcome in self.outcomes.items() if outcome == UNDECIDED]
        found = {name: self.cells.get((name, "")) for name in names}
        return {n: cell.text if cell else "no run has a verdict on it" for n, cell in found.items()}

    @property
    def sums(self) -> str:
        return ", ".join(f"{count} {outcome}" for outcome, count in self.counts.items())

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
            "runs": [flown.to_dict() for flown in self.runs],
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
            runs.append(FlownRun(run, *ended, verdicts, report["wall_time"], *relative))
    return CampaignResults(campaign, runs)


def _cell(found: Sequence[tuple[Verdict, FlownRun]]) -> MatrixCell:
    verdicts = [verdict for verdict, _ in found]
    outcomes = [verdict.outcome for verdict in verdicts]
    units = {verdict.unit for verdict in verdicts if verdict.margin is not None}
    margins = [verdict.margin for verdict in verdicts if verdict.margin is not None]
    reactions = [each.reaction_time for each in verdicts if each.reaction_time is not None]
    worst, flown = min(found, key=lambda entry: _badness(entry[0]))
    return MatrixCell(
        next((each for each in (FAILED, PASSED) if each in outcomes), UNDECIDED),
        min(margins) if len(units) == 1 else None,
        "".join(units) if len(units) == 1 else "",
        max(reactions, default=None),
        flown,
        worst.text,
    )


def _badness(verdict: Verdict) -> tuple[int, float]:
    margin = float("inf") if verdict.margin is None else verdict.margin
    return (FAILED, UNDECIDED, PASSED).index(verdict.outcome), margin


def campaign_page(results: CampaignResults) -> str:
    campaign, names = results.campaign, [each.name for each in results.campaign.expectations]
    faults = [", ".join(each) or "no fault" for each in results.scenarios.values()]
    matrix: list[list[Any]] = [["requirement", "verdict", *map(_below, results.scenarios, faults)]]
    for name, expectations in results.requirements.items():
        text = campaign.requirements.get(name, ", ".join(expectations))
        cells = [results.cells.get((name, each)) for each in ("", *results.scenarios)]
        matrix.append([_below(name, text), *map(_field, cells)])
    runs = []
    for number, flown in enumerate(results.runs, 1):
        ending = flown.ending if flown.ending == COMPLETED else ENDINGS[flown.ending]
        judged = {each.name: str(_cell([(each, flown)])) for each in flown.verdicts}
        times = f"{flown.reached:.3f}", f"{flown.wall_time:.2f}"
        row = [judged.get(name, "-") for name in names]
        runs.append([number, flown.run.name, ending, *times, *row, _links(flown)])
    failed = [flown for flown in results.runs if flown.failures]
    return render_page(
        _BODY,
        campaign.name,
        system=" ".join(campaign.system.words),
        counts=results.sums,
        matrix=matrix,
        failures=[
            (flown.run.name, _links(flown), "\n".join(flown.failures).splitlines())
            for flown in failed[:_MOST_FAILURES]
        ],
        heading=["number", "run", "ending", "simulated [s]", "real [s]", *names, "artefacts"],
        runs=runs,
    )


def _below(name: str, text: str) -> Markup:
    return Markup('{}<br><span class="none">{}</span>').format(printable(name), printable(text))


def _field(cell: MatrixCell | None) -> Markup:
    if cell is None:
        return Markup("<b>no verdict</b>")
    rest = cell.text if cell.outcome == UNDECIDED else str(cell).removeprefix(cell.outcome)
    return Markup('<b class="{0}">{0}</b> {1}<br>{2}').format(
        cell.outcome, printable(rest), _links(cell.worst)
    )


def _links(flown: FlownRun) -> Markup:
    files = {"report": flown.report, "bag": flown.bag}
    link = Markup('<a href="{}">{}</a> ')
    return Markup("").join(link.format(quote(p), name) for name, p in files.items() if p)
