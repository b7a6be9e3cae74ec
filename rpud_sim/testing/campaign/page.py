"""Page of a campaign: the matrix of requirements by scenarios and their faults, and all runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal
from urllib.parse import quote

import numpy as np

from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Axis, Layer, Plot, Points, Rule
from rpud_sim.pages.quantities import number_text
from rpud_sim.testing.campaign.outcome import COMPLETED, ENDINGS, SYSTEM
from rpud_sim.testing.campaign.results import CampaignResults, FlownRun, MatrixCell, Requirement
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


def campaign_page(results: CampaignResults) -> str:
    """Return the HTML page of a campaign."""
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
                "cells": [_cell(each.cells.get(scenario.name)) for scenario in results.scenarios],
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
        runs=[_run(number, flown) for number, flown in enumerate(results.runs, 1)],
    )


def _text(requirement: Requirement) -> str:
    if requirement.identifier == SYSTEM:
        return "It answers every period, to the end."
    return requirement.text or ", ".join(requirement.expectations)


def _links(flown: FlownRun) -> dict[str, str]:
    return {"bag": quote(flown.bag), "report": quote(flown.report)}


def _cell(cell: MatrixCell | None) -> dict[str, Any] | None:
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


def _run(number: int, flown: FlownRun) -> dict[str, Any]:
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
