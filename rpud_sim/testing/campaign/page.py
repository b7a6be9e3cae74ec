"""Page of a campaign: the matrix of requirements by scenarios and their faults, and all runs."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from rpud_sim.pages.frame import render_page
from rpud_sim.testing.campaign.outcome import COMPLETED, ENDINGS, SYSTEM
from rpud_sim.testing.campaign.results import Cell, FlownRun, Requirement, Results
from rpud_sim.testing.campaign.system_entry import program_words
from rpud_sim.verdicts.verdict import FAILED, UNDECIDED

_BODY = """
<style>
 .passed { background: #e3f4e8; } .failed { background: #fbe3dc; }
 .undecided { background: #f1f1f1; } td b { text-transform: capitalize; }
 .matrix th, .matrix td { min-width: 8em; }
 pre { background: #eef3f7; padding: .6em; overflow-x: auto; }
</style>
<p>{{ account }}</p>
<div class="tiles">
{% for name, value in tiles %}
<div class="tile"><b>{{ value }}</b>{{ name }}</div>
{% endfor %}
</div>
<h2>Requirements by faults</h2>
<p>Each field has the number of verdicts, the least margin, the longest time to react, and the bag
of the run with the worst verdict. A verdict is undecided where a run does not decide it: the fault
of which it speaks does not occur, or the run ends before.</p>
<div class="wide"><table class="matrix">
<thead><tr><th>requirement</th>
{% for name, faults in scenarios %}
<th>{{ name }}<br><span class="none">{{ faults }}</span></th>
{% endfor %}
</tr></thead><tbody>
{% for row in rows %}
<tr><th class="{{ row.outcome }}">{{ row.identifier }}<br>{{ row.text }}</th>
{% for cell in row.cells %}
{% if cell %}
<td class="{{ cell.outcome }}"><b>{{ cell.outcome }}</b> {{ cell.counts }}
{% for line in cell.lines %}
<br>{{ line }}
{% endfor %}
{% if cell.bag %}
<br><a href="{{ cell.bag }}">bag</a>
{% endif %}
</td>
{% else %}
<td class="undecided"><b>no expectation</b></td>
{% endif %}
{% endfor %}
</tr>
{% endfor %}
</tbody></table></div>
{% if failures %}
<h2>What failed</h2>
{% for failure in failures %}
<h3>{{ failure.title }}</h3>
<p>{{ failure.run }}{% if failure.bag %}, <a href="{{ failure.bag }}">bag</a>{% endif %}</p>
<pre>{% for line in failure.lines %}{{ line }}
{% endfor %}</pre>
{% endfor %}
{% endif %}
<h2>Runs</h2>
<div class="wide"><table>
<thead><tr><th>run</th><th>ending</th><th>simulated [s]</th><th>passed</th><th>failed</th>
<th>undecided</th><th>bag</th><th>digest</th></tr></thead><tbody>
{% for run in runs %}
<tr class="{{ run.outcome }}"><td>{{ run.name }}</td><td>{{ run.ending }}</td>
<td>{{ run.reached }}</td>
{% for count in run.counts %}
<td>{{ count }}</td>
{% endfor %}
<td>{% if run.bag %}<a href="{{ run.bag }}">bag</a>{% endif %}</td><td>{{ run.digest }}</td></tr>
{% endfor %}
</tbody></table></div>
"""
_MOST_FAILURES = 100  # in full: the table of runs has all


def campaign_page(results: Results) -> str:
    """Return the HTML page of a campaign; its links are relative to the campaign's folder."""
    campaign = results.campaign
    scenarios = campaign.scenarios
    failures = [
        _failure(flown, verdict)
        for flown in results.runs
        for verdict in flown.outcome.verdicts
        if verdict.outcome == FAILED
    ]
    return render_page(
        _BODY,
        campaign.name,
        account=f"System under test: {program_words(campaign.system.command)}",
        tiles=[
            *((f"requirements {name}", count) for name, count in results.counts.items()),
            ("runs", len(results.runs)),
            ("digest of the results", results.digest[:16]),
        ],
        scenarios=[(each.name, ", ".join(each.faults) or "no fault") for each in scenarios],
        rows=[
            {
                "identifier": each.identifier,
                "text": _text(each),
                "outcome": each.outcome,
                "cells": [_cell(each.cells.get(scenario.name)) for scenario in scenarios],
            }
            for each in results.requirements
        ],
        failures=failures[:_MOST_FAILURES],
        runs=[_run(flown) for flown in results.runs],
    )


def _text(requirement: Requirement) -> str:
    if requirement.identifier == SYSTEM:
        return "It answers every period, to the end."
    return requirement.text or ", ".join(requirement.expectations)


def _cell(cell: Cell | None) -> dict[str, Any] | None:
    if cell is None:
        return None
    lines = []
    if cell.margin is not None:
        lines.append(f"margin {cell.margin:.4g} {cell.unit}".rstrip())
    if cell.reaction_time is not None:
        lines.append(f"reacts in {cell.reaction_time:.3f} s")
    if cell.outcome == UNDECIDED:
        lines.append(cell.verdict.text)
    return {
        "outcome": cell.outcome,
        "counts": ", ".join(f"{count} {name}" for name, count in cell.counts.items() if count),
        "lines": lines,
        "bag": quote(cell.worst.bag),
    }


def _failure(flown: FlownRun, verdict: Any) -> dict[str, Any]:
    title = f"{verdict.requirement}: {verdict.name}" if verdict.requirement else verdict.name
    margin = "" if verdict.margin is None else f", margin {verdict.margin:.6g} {verdict.unit}"
    lines = [f"{verdict.text}{margin}"]
    if verdict.name == SYSTEM:
        lines = flown.outcome.text.splitlines()
    return {"title": title, "run": flown.run.name, "bag": quote(flown.bag), "lines": lines}


def _run(flown: FlownRun) -> dict[str, Any]:
    outcome = flown.outcome
    counts = [
        sum(each.outcome == name for each in outcome.verdicts)
        for name in ("passed", "failed", "undecided")
    ]
    return {
        "name": flown.run.name,
        "ending": COMPLETED if outcome.ending == COMPLETED else ENDINGS[outcome.ending],
        "reached": f"{outcome.reached:.3f}",
        "counts": counts,
        "outcome": FAILED if counts[1] else "",
        "bag": quote(flown.bag),
        "digest": outcome.digest[:16],
    }
