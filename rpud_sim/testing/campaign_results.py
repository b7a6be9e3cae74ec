"""Results of a campaign: each requirement under each scenario, as table, JSON and page."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Axis, Layer, Plot, Points, Rule
from rpud_sim.pages.quantities import number_text
from rpud_sim.testing.campaign_file import (
    Campaign,
    CampaignRun,
    CampaignScenario,
    read_campaign,
)
from rpud_sim.testing.campaign_runs import (
    COMPLETED,
    ENDINGS,
    SYSTEM,
    RunOutcome,
    outcome_from_json,
)
from rpud_sim.verdicts import Verdict
from rpud_sim.verdicts.verdict import FAILED, OUTCOMES, PASSED, UNDECIDED

_BODY = """
<style>
 .passed { box-shadow: inset 4px 0 var(--series2); }
 .failed { box-shadow: inset 4px 0 var(--fault); }
 .undecided { color: var(--muted); } td b { text-transform: capitalize; }
 .failed b { color: var(--fault); }
 .matrix th, .matrix td { min-width: 8em; }
 pre { background: var(--panel); padding: .6em; overflow-x: auto; }
</style>
{%- macro links(run) %}
{% if run.report %}<a href="{{ run.report }}">report</a> {% endif %}
{% if run.bag %}<a href="{{ run.bag }}">bag</a>{% endif %}
{%- endmacro %}
<p>System under test: {{ system }}</p>
<div class="tiles">
{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>
{% endfor %}
</div>
<h2>Requirements by faults</h2>
<p>Each field has the number of verdicts, the least margin, the longest time to react, and the run
with the worst verdict. A verdict is undecided if the fault of which it speaks does not occur, or
if the run ends before.</p>
<div class="wide" tabindex="0" role="region" aria-label="Requirements by faults">
<table class="matrix"><caption>Requirements by scenarios and their faults</caption>
<thead><tr><th scope="col">requirement</th>
{% for name, faults in scenarios %}
<th scope="col">{{ name }}<br><span class="none">{{ faults }}</span></th>
{% endfor %}
</tr></thead><tbody>
{% for row in rows %}
<tr><th scope="row" class="{{ row.outcome }}">{{ row.identifier }}<br>{{ row.text }}</th>
{% for cell in row.cells %}
{% if cell %}
<td class="{{ cell.outcome }}"><b>{{ cell.outcome }}</b> {{ cell.counts }}
{% for line in cell.lines %}
<br>{{ line }}
{% endfor %}
<br>{{ links(cell) }}
</td>
{% else %}
<td class="undecided"><b>no verdict</b></td>
{% endif %}
{% endfor %}
</tr>
{% endfor %}
</tbody></table></div>
{% if failures %}
<h2>What failed</h2>
{% for failure in failures %}
<h3>{{ failure.name }}</h3>
<p>{{ links(failure) }}</p>
<pre tabindex="0" role="region" aria-label="Reasons">{% for line in failure.lines %}{{ line }}
{% endfor %}</pre>
{% endfor %}
{% endif %}
{% if plots %}
<h2>Margins and reaction times</h2>
<p>A margin says by how much an expectation holds; below zero it failed. The runs have the numbers
of the table below.</p>
{{ figures(plots, 20) }}
{% endif %}
<h2>Runs</h2>
<div class="wide" tabindex="0" role="region" aria-label="Runs"><table>
<caption>All runs</caption>
<thead><tr>
{% for name in ("number", "run", "ending", "simulated [s]", "real [s]", "passed", "failed",
 "undecided", "artefacts") %}
<th scope="col">{{ name }}</th>
{% endfor %}
</tr></thead><tbody>
{% for run in runs %}
<tr class="{{ run.outcome }}">{% for cell in run.cells %}<td>{{ cell }}</td>{% endfor %}
<td>{{ links(run) }}</td></tr>
{% endfor %}
</tbody></table></div>
"""
_MOST_FAILURES = 100  # in full: the table of runs has all
_MARKERS: dict[str, tuple[Literal["circle", "x"], str]] = {
    PASSED: ("circle", "series2"),
    FAILED: ("x", "fault"),
}


@dataclasses.dataclass(frozen=True)
class FlownRun:
    """Run of a campaign with its outcome."""

    run: CampaignRun
    outcome: RunOutcome
    wall_time: float = 0.0  # that it took [s]
    bag: str = ""  # path of its bag, relative to the page; empty for none
    report: str = ""  # path of its report page, likewise

    def to_dict(self) -> dict[str, Any]:
        return {
            "run": self.run.name,
            "scenario": self.run.scenario.name,
            "faults": list(self.run.scenario.faults),
            "parameters": dict(self.run.parameters),
            "seed": self.run.setup.seed,
            "wall_time": self.wall_time,
            "bag": self.bag,
            "report": self.report,
            **dataclasses.asdict(self.outcome),
        }


@dataclasses.dataclass(frozen=True)
class MatrixCell:
    """Verdicts on one requirement in some runs."""

    counts: Mapping[str, int]  # of each outcome
    margin: float | None  # the least one; None without any
    unit: str  # of the margin
    reaction_time: float | None  # the longest one [s]; None without any
    worst: FlownRun  # run that shows the worst verdict
    verdict: Verdict  # that verdict

    @property
    def outcome(self) -> str:
        """Failed if one failed, passed if one passed, undecided otherwise."""
        return next((each for each in (FAILED, PASSED) if self.counts[each]), UNDECIDED)

    def __str__(self) -> str:
        margin = "" if self.margin is None else f" {self.margin:.3g} {self.unit}".rstrip()
        reaction = "" if self.reaction_time is None else f" in {self.reaction_time:.2f} s"
        return f"{self.outcome}{margin}{reaction}"


@dataclasses.dataclass(frozen=True)
class Requirement:
    """Requirement with its cells."""

    identifier: str  # the expectation's name where it has none
    text: str  # empty if the campaign gives none
    expectations: tuple[str, ...]  # names
    cells: Mapping[str, MatrixCell]  # by the name of the scenario; none without an expectation
    whole: MatrixCell | None  # of all runs; None without an expectation

    @property
    def outcome(self) -> str:
        return UNDECIDED if self.whole is None else self.whole.outcome


@dataclasses.dataclass(frozen=True)
class CampaignResults:
    """Results of those runs of a campaign that were flown."""

    campaign: Campaign
    runs: tuple[FlownRun, ...]  # in the order of the campaign
    # the system under test itself first, then as the campaign has them
    requirements: tuple[Requirement, ...]

    @property
    def scenarios(self) -> tuple[CampaignScenario, ...]:
        return tuple({each.run.scenario.name: each.run.scenario for each in self.runs}.values())

    @property
    def counts(self) -> dict[str, int]:
        """Number of requirements by outcome."""
        outcomes = [each.outcome for each in self.requirements]
        return {outcome: outcomes.count(outcome) for outcome in OUTCOMES}

    @property
    def undecided(self) -> dict[str, str]:
        """Requirements that no run decides, with the reason of one verdict."""
        return {
            each.identifier: each.whole.verdict.text if each.whole else "no run has a verdict on it"
            for each in self.requirements
            if each.outcome == UNDECIDED
        }

    def lines(self) -> list[str]:
        """Return the matrix of requirements by scenarios as lines of a table."""
        names = [scenario.name for scenario in self.scenarios]
        rows = [["requirement", "verdict", *names]]
        for each in self.requirements:
            cells = [str(each.cells.get(name, "-")) for name in names]
            rows.append([each.identifier, each.outcome, *cells])
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.counts.items())
        return [
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
            "",
            f"requirements: {counts}",
        ]

    def to_dict(self) -> dict[str, Any]:
        return {
            "campaign": self.campaign.name,
            "counts": self.counts,
            "requirements": {each.identifier: each.outcome for each in self.requirements},
            "runs": [each.to_dict() for each in self.runs],
        }


def results_from_reports(
    file: Path, reports: Collection[Mapping[str, Any]], place: Path
) -> CampaignResults:
    """Return the results of what pytest has reported of runs; ``place`` is the page's folder."""
    campaign = read_campaign(file)
    found = {report["name"]: report for report in reports}
    runs = []
    for run in campaign.runs:
        if report := found.get(run.name):
            files = (report.get(name, "") for name in ("rpud_bag", "rpud_report"))
            relative = [file and Path(file).relative_to(place).as_posix() for file in files]
            outcome = outcome_from_json(report["outcome"])
            runs.append(FlownRun(run, outcome, report["wall_time"], *relative))
    return results_of(campaign, runs)


def results_of(campaign: Campaign, runs: Sequence[FlownRun]) -> CampaignResults:
    names: dict[str, list[str]] = {SYSTEM: [SYSTEM], **{key: [] for key in campaign.requirements}}
    for expectation in campaign.expectations:
        identifier = expectation.requirement or expectation.name
        names.setdefault(identifier, []).append(expectation.name)
    requirements = []
    for identifier, expectations in names.items():
        cells = {}
        for scenario in dict.fromkeys(each.run.scenario.name for each in runs):
            own = [each for each in runs if each.run.scenario.name == scenario]
            cell = _cell(own, expectations)
            if cell is not None:
                cells[scenario] = cell
        text = campaign.requirements.get(identifier, "")
        whole = _cell(runs, expectations)
        requirements.append(Requirement(identifier, text, tuple(expectations), cells, whole))
    return CampaignResults(campaign, tuple(runs), tuple(requirements))


def _cell(runs: Sequence[FlownRun], names: Sequence[str]) -> MatrixCell | None:
    found = [
        (verdict, run) for run in runs for verdict in run.outcome.verdicts if verdict.name in names
    ]
    if not found:
        return None
    units = {verdict.unit for verdict, _ in found if verdict.margin is not None}
    margins = [verdict.margin for verdict, _ in found if verdict.margin is not None]
    reactions = [v.reaction_time for v, _ in found if v.reaction_time is not None]
    verdict, run = min(found, key=_badness)
    return MatrixCell(
        {outcome: sum(v.outcome == outcome for v, _ in found) for outcome in OUTCOMES},
        min(margins) if len(units) == 1 else None,  # margins in two units have no least
        units.pop() if len(units) == 1 else "",
        max(reactions, default=None),
        run,
        verdict,
    )


def _badness(entry: tuple[Verdict, FlownRun]) -> tuple[int, float]:
    verdict = entry[0]
    margin = float("inf") if verdict.margin is None else verdict.margin
    return (FAILED, UNDECIDED, PASSED).index(verdict.outcome), margin


def campaign_page(results: CampaignResults) -> str:
    failed = [flown for flown in results.runs if flown.outcome.failures]
    return render_page(
        _BODY,
        results.campaign.name,
        system=results.campaign.system.command_line,
        tiles=[
            *((f"requirements {name}", count) for name, count in results.counts.items()),
            ("runs", len(results.runs)),
        ],
        scenarios=[(each.name, ", ".join(each.faults) or "no fault") for each in results.scenarios],
        rows=[
            {
                "identifier": each.identifier,
                "text": _text(each),
                "outcome": each.outcome,
                "cells": [_cell_content(each.cells.get(one.name)) for one in results.scenarios],
            }
            for each in results.requirements
        ],
        failures=[
            {
                "name": flown.run.name,
                "lines": [line for text in flown.outcome.failures for line in text.splitlines()],
                **_links(flown),
            }
            for flown in failed[:_MOST_FAILURES]
        ],
        plots=_plots(results, "margin", min) + _plots(results, "reaction_time", max),
        runs=[_run_content(number, flown) for number, flown in enumerate(results.runs, 1)],
    )


def _text(requirement: Requirement) -> str:
    if requirement.identifier == SYSTEM:
        return "It answers every period, to the end."
    return requirement.text or ", ".join(requirement.expectations)


def _links(flown: FlownRun) -> dict[str, str]:
    return {"bag": quote(flown.bag), "report": quote(flown.report)}


def _cell_content(cell: MatrixCell | None) -> dict[str, Any] | None:
    if cell is None:
        return None
    lines = []
    if cell.margin is not None:
        lines.append(f"margin {number_text(cell.margin)} {cell.unit}".rstrip())
    if cell.reaction_time is not None:
        lines.append(f"reacts in {cell.reaction_time:.3f} s")
    if cell.outcome == UNDECIDED:
        lines.append(cell.verdict.text)
    counts = ", ".join(f"{count} {name}" for name, count in cell.counts.items() if count)
    return {"outcome": cell.outcome, "counts": counts, "lines": lines, **_links(cell.worst)}


def _run_content(number: int, flown: FlownRun) -> dict[str, Any]:
    outcome = flown.outcome
    verdicts = [verdict.outcome for verdict in outcome.verdicts]
    ending = COMPLETED if outcome.ending == COMPLETED else ENDINGS[outcome.ending]
    times = (f"{outcome.reached:.3f}", f"{flown.wall_time:.2f}")
    return {
        "outcome": FAILED if FAILED in verdicts else "",
        "cells": [number, flown.run.name, ending, *times, *map(verdicts.count, OUTCOMES)],
        **_links(flown),
    }


def _plots(results: CampaignResults, field: str, worst: Any) -> tuple[Plot, ...]:
    """Return a number of the verdicts over the runs, a plot for each expectation that has it."""
    found = []
    for expectation in results.campaign.expectations:
        points = [
            (number, getattr(verdict, field), verdict)
            for number, flown in enumerate(results.runs, 1)
            for verdict in flown.outcome.verdicts
            if verdict.name == expectation.name and getattr(verdict, field) is not None
        ]
        if points:
            number, value, verdict = worst(points, key=lambda point: point[1])
            unit = verdict.unit if field == "margin" else "s"
            title = f"{field.replace('_', ' ')}: {expectation.name}"
            alt = f"Worst: {number_text(value)} {unit}".rstrip() + f" in run {number}."
            axes = Axis(unit=unit), Axis("run")
            found.append(
                Plot(title, _layers(points, field == "margin"), alt, *axes, height=130, width=344)
            )
    return tuple(found)


def _layers(points: Sequence[tuple[int, float, Any]], limited: bool) -> tuple[Layer, ...]:
    layers: list[Layer] = [Rule("limit", 0.0, color="muted")] if limited else []
    for outcome, (marker, color) in _MARKERS.items():
        chosen = [(number, value) for number, value, each in points if each.outcome == outcome]
        if chosen:
            x, y = np.array(chosen, float).T
            layers.append(Points(outcome, x, y, marker=marker, size=7.0, color=color))
    return tuple(layers)
