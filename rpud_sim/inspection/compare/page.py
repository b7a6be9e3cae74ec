"""Page of a comparison: one HTML file in the style of all pages."""

from __future__ import annotations

import os
from typing import Any

from rpud_sim.inspection.compare.estimates import DIFFERS, Estimate
from rpud_sim.inspection.compare.plots import (
    difference_plot,
    distribution_plots,
    hidden_commands,
    label,
    time_plots,
)
from rpud_sim.inspection.compare.results import Comparison, QuantityComparison, WindowComparison
from rpud_sim.inspection.compare.same_bits import EQUAL, TopicBits, first_different
from rpud_sim.inspection.compare.values import COUNTERS, FIGURES, MEAN, MEDIAN, P95, TIMING
from rpud_sim.inspection.output import write_new_file
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.quantities import NONE as _UNSET
from rpud_sim.pages.quantities import QUANTITIES, Quantity

_MOST_DRAWN = 3  # windows whose distributions are drawn
_MOST_NAMED = 6  # settings that differ, which the page names above its plot
_SHOWN_TEXT = 80  # characters of a value of a message

_HEADINGS = {
    "runs": ("run", "bag", "drill", "run in the bag", "from [s]", "to [s]"),
    "bits": (
        "topic", "bits", "equal messages", "first difference [s]", "field", "in A", "here", "",
    ),
    "figures": (
        "quantity", "figure", "run", "A", "run", "difference", "95 % interval", "p", "decision",
    ),
    "of_runs": (
        "quantity", "run", "values", "blocks", "mean", "interval", "median", "interval",
        "95 % below", "interval", "greatest",
    ),
}  # fmt: skip

_BODY = """\
<p class="verdict">{{ verdict }}</p>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<p>{% for name, bag in named %}{{ name }}: <code>{{ bag }}</code>{{ ". " if loop.last else "; " }}
{% endfor %}
{{ settings }}</p>
{% for item in windows %}
{% if loop.first %}
{% if windows | length > 1 %}<h2>{{ item.name }}</h2>{% endif %}
{% if item.plot %}{{ figure(item.plot) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
{% else %}
<details><summary>{{ item.name }}: {{ item.count }}</summary>
{% if item.plot %}{{ figure(item.plot) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
</details>
{% endif %}
{% endfor %}

<details id="figures"><summary>Figures in numbers</summary>
<p>Intervals are 95 % confidence intervals by a stationary block bootstrap, since impacts that
follow each other are not independent. Decisions are corrected for their number by Holm's method:
if the runs were of one kind, one comparison in twenty would name a difference.
{% if tolerance %}A difference up to {{ tolerance }} counts as none.{% endif %}</p>
{% for item in windows %}
<h3>{{ item.name }}</h3>
{{ table(headings.figures, item.rows, caption="Figures of each run, and differences from A") }}
{{ table(headings.of_runs, item.of_runs, caption="Values of each run with their intervals") }}
{% endfor %}
</details>

<details id="distributions"><summary>Distributions</summary>
<p>Share of the values in each of 60 classes [%].</p>
{% for name, plots in distributions %}
{% if distributions | length > 1 %}<h3>{{ name }}</h3>{% endif %}
{{ figures(plots, 20) }}
{% else %}<p class="none">There are no values.</p>{% endfor %}
{% if not_drawn %}<p class="none">Not drawn: {{ not_drawn }} further segments.</p>{% endif %}
</details>

<details id="time"><summary>Over time</summary>
{% if over_time %}<p>Line: mean; band: least to greatest.
{% if hidden %}{{ hidden }} commands are not drawn: their table has all.{% endif %}</p>
{{ figures(over_time, 30) }}
{% else %}<p class="none">There are no series.</p>{% endif %}
</details>

<details id="settings"><summary>Runs, settings, commands and faults</summary>
{{ table(headings.runs, runs, caption="A is the reference") }}
{% if parameters %}
{{ table(headings.parameters, parameters, caption="Parameters that differ") }}
{% else %}<p class="none">No parameter differs.</p>{% endif %}
{% if versions %}
{{ table(headings.versions, versions, false, "Versions that differ") }}
{% else %}<p class="none">All runs are of the same software and machine.</p>{% endif %}
{% if commands %}
{{ table(headings.commands, commands, caption="Commands, aligned") }}
{% else %}<p class="none">No run has a command.</p>{% endif %}
{% if faults %}
{{ table(headings.faults, faults, caption="Faults, aligned, from onset to end") }}
{% else %}<p class="none">No run has a fault.</p>{% endif %}
</details>

<details id="bits"><summary>Bits</summary>
<p>Messages of each topic side by side, as far as both runs hold it. Times count from the beginning
of each run.</p>
{% for name, line, rows in bits %}
<h3>{{ name }}</h3>
<p>{{ line }}</p>
{{ table(headings.bits, rows, caption="Messages beside those of A") }}
{% endfor %}
</details>

<details id="timing"><summary>Timing of the machine</summary>
<p>These belong to the machine that ran the drill, not to the drill, and are not tested.</p>
{{ table(headings.timing, timing, caption="From the reports in status") }}
</details>
"""


def write_page(found: Comparison, out: str | os.PathLike[str]) -> None:
    write_new_file(out, render(found))


def render(found: Comparison) -> str:
    letters = found.letters
    drawn = found.windows[:_MOST_DRAWN]
    return render_page(
        _BODY,
        " and ".join(found.names) if len(found.names) < 3 else f"{len(found.names)} runs",
        verdict=found.sentence,
        named=[(letter, drill.path) for letter, drill in zip(letters, found.drills, strict=True)],
        settings=_settings_line(found),
        warnings=[
            *found.warnings,
            *(
                f"Not compared: {name}: {part}: {reason}"
                for name, parts in found.damaged.items()
                for part, reason in parts.items()
            ),
        ],
        letters=letters,
        headings={
            **_HEADINGS,
            "parameters": ("parameter", *letters, "unit"),
            "versions": ("software or machine", *letters),
            "commands": ("command", *(f"{letter} [s]" for letter in letters)),
            "faults": ("fault", *(f"{letter} [s]" for letter in letters)),
            "timing": ("", *letters),
        },
        runs=[
            (
                letter,
                drill.path,
                drill.namespace or "/",
                f"{drill.number} of {drill.runs}",
                f"{values.begin:.6f}",
                f"{values.end:.6f}",
            )
            for letter, drill, values in zip(letters, found.drills, found.values, strict=True)
        ],
        parameters=[
            (each.name, *(value or _UNSET for value in each.values), each.unit)
            for each in found.parameters
        ],
        versions=[(each.name, *(v or _UNSET for v in each.values)) for each in found.versions],
        commands=[
            (each.text, *(_UNSET if t is None else f"{t:.6f}" for t in each.times))
            for each in found.commands
        ],
        faults=[(each.text, *map(_span, each.times, each.ends)) for each in found.faults],
        bits=[
            (label(found, number), _bits_line(run), [_bits_row(topic) for topic in run])
            for number, run in enumerate(found.bits, 1)
        ],
        tolerance=f"{100.0 * found.tolerance:g} %" if found.tolerance else "",
        # The one with the most differences is open.
        windows=sorted(
            (_window(found, window) for window in found.windows),
            key=lambda item: -item["differing"],
        ),
        distributions=[(window.name, list(distribution_plots(found, window))) for window in drawn],
        not_drawn=len(found.windows) - len(drawn),
        over_time=time_plots(found),
        hidden=hidden_commands(found),
        timing=_timing_rows(found),
    )


def _span(time: float | None, end: float | None) -> str:
    if time is None:
        return _UNSET
    return f"{time:.6f} to {end:.6f}" if end is not None else f"{time:.6f}, lasts"


def _bits_line(run: tuple[TopicBits, ...]) -> str:
    states = {topic.state for topic in run}
    if first := first_different(run):
        return f"They differ from {first.time:.9f} s on, first in {first.topic}."
    return "All bits are equal." if EQUAL in states else "There is nothing to compare."


def _bits_row(topic: TopicBits) -> tuple[str, ...]:
    time = _UNSET if topic.time is None else f"{topic.time:.9f}"
    values = (topic.field, topic.reference[:_SHOWN_TEXT], topic.other[:_SHOWN_TEXT])
    return (topic.topic, topic.state, str(topic.messages), time, *values, topic.note)


def _settings_line(found: Comparison) -> str:
    if not found.parameters:
        return "No parameter differs."
    texts = [
        f"{each.name} {' and '.join(value or _UNSET for value in each.values)} {each.unit}".rstrip()
        for each in found.parameters[:_MOST_NAMED]
    ]
    more = len(found.parameters) - len(texts)
    return f"What differs: {', '.join(texts)}{f', and {more} more' if more else ''}."


def _window(found: Comparison, window: WindowComparison) -> dict[str, Any]:
    rows = [
        (
            each.compared.shown.label,
            FIGURES[each.figure],
            letter,
            *each.texts,
            f"{each.chance:.2g}" if each.chance == each.chance else _UNSET,
            each.decision,
        )
        for quantity in window.quantities
        for letter, run in zip(found.letters[1:], quantity.differences, strict=True)
        for each in run
    ]
    differing = sum(row[-1] == DIFFERS for row in rows)
    return {
        "name": f"{window.name[:1].upper()}{window.name[1:]}, {window.spans}",
        "differing": differing,
        "count": f"{differing} of {len(rows)} figures differ",
        "plot": difference_plot(found, window),
        "rows": rows,
        "of_runs": [
            row for quantity in window.quantities for row in _values(quantity, found.letters)
        ],
    }


def _values(quantity: QuantityComparison, letters: str) -> list[tuple[str, ...]]:
    shown, rows = quantity.compared.shown, []
    for letter, run in zip(letters, quantity.runs, strict=True):
        if run is None:
            rows.append((shown.label, letter, "0", *([_UNSET] * 8)))
            continue
        cells = [
            cell
            for name in (MEAN, MEDIAN, P95)
            for cell in _estimate(shown, run.estimates.get(name))
        ]
        blocks = f"{run.estimates[MEAN].blocks:.0f}"
        greatest = shown.text(run.greatest)
        rows.append((shown.label, letter, str(run.count), blocks, *cells, greatest))
    return rows


def _estimate(shown: Quantity, each: Estimate | None) -> tuple[str, str]:
    if each is None:
        return _UNSET, _UNSET
    low, high = shown.text(each.low, unit=False), shown.text(each.high)
    return shown.text(each.value), _UNSET if _UNSET in (low, high) else f"{low} to {high}"


def _timing_rows(found: Comparison) -> list[tuple[str, ...]]:
    rows = []
    for name, title, unit in TIMING:
        shown = QUANTITIES["lateness"] if unit == "s" else Quantity("", "", "")
        for kind in ("median", "greatest"):
            cells = [shown.text(getattr(timing, kind)[name]) for timing in found.timing]
            rows.append((f"{title}, {kind}", *cells))
    for name, title in COUNTERS:
        counts = [timing.counters[name] for timing in found.timing]
        rows.append((title, *(_UNSET if count is None else str(count) for count in counts)))
    return rows
