"""Page of a campaign: the matrix of requirements by scenarios and their faults, and all runs.

Over the runs it plots margins, times to react and durations.
"""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

from rpud_sim.pages import figures  # noqa: F401 - where Bokeh is missing, it fails before a run
from rpud_sim.pages.frame import render_page
from rpud_sim.testing.campaign.outcome import COMPLETED, ENDINGS, SYSTEM
from rpud_sim.testing.campaign.results import Cell, FlownRun, Requirement, Results
from rpud_sim.testing.campaign.run_plots import duration_plots, margin_plots, reaction_plots
from rpud_sim.testing.campaign.system_entry import program_words
from rpud_sim.verdicts.verdict import FAILED, UNDECIDED

_BODY = """
<style>
 .passed { box-shadow: inset 4px 0 var(--series2); }
 .failed { box-shadow: inset 4px 0 var(--fault); }
 .undecided { color: var(--muted); } td b { text-transform: capitalize; }
 .failed b { color: var(--fault); }
 .matrix th, .matrix td { min-width: 8em; }
 pre { background: var(--panel); padding: .6em; overflow-x: auto; }
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
{% if failed %}
<h2>Runs that failed</h2>
{{ table(("run", "scenario", "parameters", "seed", "failed"), failed, false, "Runs that failed") }}
{{ table(("seed", "runs", "failed", "in the scenarios"), seeds, false, "Failures by seed") }}
{% endif %}
{% if failures %}
<h2>What failed</h2>
{% for failure in failures %}
<h3>{{ failure.title }}</h3>
<p>{{ failure.run }}{% if failure.bag %}, <a href="{{ failure.bag }}">bag</a>{% endif %}</p>
<pre tabindex="0" role="region" aria-label="Reason">{% for line in failure.lines %}{{ line }}
{% endfor %}</pre>
{% endfor %}
{% endif %}
<h2>Margins</h2>
{% if margins %}
<p>A margin says by how much an expectation holds; below zero it failed. The runs have the numbers
of the table below.</p>
{{ grid("margins", margins, 20) }}
{% else %}
<p class="none">No verdict has a margin.</p>
{% endif %}
{% if reactions %}
<h2>Times to react</h2>
{{ grid("reactions", reactions, 20) }}
{% endif %}
<h2>Durations</h2>
{{ grid("durations", durations, 20) }}
<h2>Runs</h2>
<div class="wide" tabindex="0" role="region" aria-label="Runs"><table>
<caption>All runs</caption>
<thead><tr>
{% for name in ("number", "run", "ending", "simulated [s]", "real [s]", "passed", "failed",
 "undecided", "bag", "digest") %}
<th scope="col">{{ name }}</th>
{% endfor %}
</tr></thead><tbody>
{% for run in runs %}
<tr class="{{ run.outcome }}"><td>{{ run.number }}</td><td>{{ run.name }}</td>
<td>{{ run.ending }}</td>
<td>{{ run.reached }}</td><td>{{ run.wall_time }}</td>
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
        failed=_failed_runs(results),
        seeds=_seeds(results),
        failures=failures[:_MOST_FAILURES],
        margins=margin_plots(results),
        reactions=reaction_plots(results),
        durations=duration_plots(results),
        runs=[_run(number, flown) for number, flown in enumerate(results.runs, 1)],
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


def _failures(flown: FlownRun) -> list[str]:
    return [each.name for each in flown.outcome.verdicts if each.outcome == FAILED]


def _failed_runs(results: Results) -> list[tuple[Any, ...]]:
    return [
        (
            number,
            flown.run.scenario.name,
            ", ".join(f"{name} = {value}" for name, value in flown.run.parameters.items()),
            flown.run.setup.seed,
            ", ".join(names),
        )
        for number, flown in enumerate(results.runs, 1)
        if (names := _failures(flown))
    ]


def _seeds(results: Results) -> list[tuple[Any, ...]]:
    """Return for each seed its runs, and how many of them failed in which scenarios."""
    rows = []
    for seed in dict.fromkeys(flown.run.setup.seed for flown in results.runs):
        runs = [flown for flown in results.runs if flown.run.setup.seed == seed]
        failed = [flown for flown in runs if _failures(flown)]
        scenarios = dict.fromkeys(flown.run.scenario.name for flown in failed)
        rows.append((seed, len(runs), len(failed), ", ".join(scenarios)))
    return rows


def _run(number: int, flown: FlownRun) -> dict[str, Any]:
    outcome = flown.outcome
    counts = [
        sum(each.outcome == name for each in outcome.verdicts)
        for name in ("passed", "failed", "undecided")
    ]
    return {
        "number": number,
        "name": flown.run.name,
        "ending": COMPLETED if outcome.ending == COMPLETED else ENDINGS[outcome.ending],
        "reached": f"{outcome.reached:.3f}",
        "wall_time": f"{outcome.wall_time:.2f}",
        "counts": counts,
        "outcome": FAILED if counts[1] else "",
        "bag": quote(flown.bag),
        "digest": outcome.digest[:16],
    }
