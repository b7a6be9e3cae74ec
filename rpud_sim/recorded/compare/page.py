"""Page of a comparison: one HTML file in the style of all pages."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from rpud_sim.recorded.compare.estimates import (
    DIFFERS,
    EQUIVALENT,
    SAME,
    TOO_FEW,
    UNDECIDED,
    FigureDifference,
)
from rpud_sim.recorded.compare.results import (
    Comparison,
    ResultTable,
    bits_line,
    figure_table,
    setting_tables,
    texts,
)
from rpud_sim.recorded.compare.values import (
    FIGURES,
    QUANTITIES,
    ComparedQuantity,
    series_of,
    shown,
)
from rpud_sim.recorded.output import write_new_file
from rpud_sim.pages.frame import render_page
from rpud_sim.pages.plot import Axis, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.quantities import NONE

_MOST_DRAWN = 3  # windows whose distributions are drawn
_CLASSES = 60  # of a histogram
_TAIL = 0.002  # share of values beyond each end of a histogram
_DECADES = 30.0  # greatest over least, above which classes are equal in the logarithm
_APART = 0.5  # between the outer runs, in rows of the differences
_ROW = 19  # height of a row of the differences [pixels]
_COLORS = {
    DIFFERS: "series1",
    SAME: "muted",
    EQUIVALENT: "series2",
    UNDECIDED: "series4",
    TOO_FEW: "muted",
}

_BODY = """\
<p class="verdict">{{ verdict }}</p>
{% for line in warnings %}<p class="warning">{{ line }}</p>
{% endfor %}
<p>{% for name, bag in named %}{{ name }}: <code>{{ bag }}</code>{{ ". " if loop.last else "; " }}
{% endfor %}
{{ settings }}</p>
{% if plot %}{{ figure(plot) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
{% for section in sections %}
<details><summary>{{ section.title }}</summary>
{% if section.text %}<p>{{ section.text }}</p>{% endif %}
{% for each in section.tables %}{{ table(each.head, each.rows, caption=each.caption) }}
{% endfor %}
{% if section.plots %}{{ figures(section.plots) }}{% endif %}
</details>
{% endfor %}
"""
_METHOD = (
    "Intervals are 95 % confidence intervals by a stationary block bootstrap, since impacts that "
    "follow each other are not independent. Decisions are corrected for their number by Holm's "
    "method: if the runs were of one kind, one comparison in twenty would name a difference."
)


class Section(NamedTuple):
    """Part of the page behind a click."""

    title: str
    text: str = ""
    tables: Sequence[ResultTable] = ()
    plots: Sequence[Plot] = ()


def write_page(found: Comparison, out: str | os.PathLike[str]) -> None:
    write_new_file(out, render(found))


def render(found: Comparison) -> str:
    parts = ((name, *part) for name, parts in found.damaged.items() for part in parts.items())
    # The window with the most differences is the first.
    windows = sorted(range(len(found.windows)), key=lambda number: -_differing(found, number))
    texts = [
        f"{each.name} {' and '.join(value or NONE for value in each.values)} {each.unit}".rstrip()
        for each in found.parameters
    ]
    tables = [table for table in setting_tables(found) if table.rows]
    return render_page(
        _BODY,
        " and ".join(found.names) if len(found.names) < 3 else f"{len(found.names)} runs",
        verdict=found.sentence,
        named=[*zip(found.letters, (drill.path for drill in found.drills), strict=True)],
        settings=f"What differs: {', '.join(texts)}." if texts else "No parameter differs.",
        warnings=[
            *found.warnings,
            *(f"Not compared: {name}: {part}: {reason}" for name, part, reason in parts),
        ],
        plot=difference_plot(found, windows[0]),
        sections=[
            *(_window(found, number, place) for place, number in enumerate(windows)),
            Section("Settings, commands and faults", "", tables),
            Section(
                "Bits",
                "Times count from the beginning of each run.",
                [_bits_table(found, run) for run in range(1, len(found.names))],
            ),
        ],
    )


def label(found: Comparison, number: int) -> str:
    """Return letter and name of a run."""
    return f"{found.letters[number]} {found.names[number]:.60}"


def _of_window(found: Comparison, number: int) -> list[FigureDifference]:
    return [each for each in found.differences if each.window == number]


def _differing(found: Comparison, number: int) -> int:
    return sum(each.decision == DIFFERS for each in _of_window(found, number))


def _window(found: Comparison, number: int, place: int) -> Section:
    window = found.windows[number]
    rows = []
    for name, runs in found.figures[number].items():
        text = shown(name).text
        for letter, run in zip(found.letters, runs, strict=True):
            cells = [NONE] * 6
            for at, figure in enumerate(run.estimates.values() if run else ()):
                low, high = text(figure.low, unit=False), text(figure.high)
                interval = NONE if NONE in (low, high) else f"{low} to {high}"
                cells[2 * at : 2 * at + 2] = text(figure.value), interval
            count, greatest = (str(run.number), text(run.max)) if run else ("0", NONE)
            rows.append((shown(name).label, letter, count, *cells, greatest))
    head = ["quantity", "run", "values"]
    head += [text for name in FIGURES.values() for text in (name, "interval")]
    differences = _of_window(found, number)
    plot = difference_plot(found, number) if place else None
    return Section(
        f"{window.name[:1].upper()}{window.name[1:]}, {window.spans}: "
        f"{_differing(found, number)} of {len(differences)} figures differ",
        _METHOD,
        [
            figure_table(found, differences),
            ResultTable("Values of each run with their intervals", (*head, "greatest"), rows),
        ],
        [
            *([plot] if plot else []),
            *(distribution_plots(found, number) if place < _MOST_DRAWN else ()),
        ],
    )


def _bits_table(found: Comparison, run: int) -> ResultTable:
    head = ("topic", "bits", "equal", "first difference [s]", "field", "in A", "here", "note")
    rows = [
        (
            *(each.topic, each.state, str(each.messages)),
            NONE if each.time is None else f"{each.time:.9f}",
            *(text[:80] for text in (each.field, each.reference, each.other, each.note)),
        )
        for each in found.bits[run - 1]
    ]
    return ResultTable(f"{label(found, run)}: {bits_line(found.bits[run - 1])}", head, rows)


def difference_plot(found: Comparison, number: int) -> Plot | None:
    """Return the relative differences of a window with their intervals; None without any."""
    differences = _of_window(found, number)
    rows = [*dict.fromkeys((each.quantity, each.figure) for each in differences)]
    known = [each for each in differences if math.isfinite(each.relative)]
    if not known:
        return None
    runs = len(found.names) - 1
    layers: list[Layer] = [Rule("", 0.0)]
    if found.tolerance:
        edge = 100.0 * found.tolerance
        layers.insert(0, Zone("tolerance", -edge, edge))
    # A layer for each run; if there is one alone, for each decision.
    groups: dict[tuple[str, str | int], list[FigureDifference]] = {}
    for each in known:
        key: tuple[str, str | int] = (each.decision, _COLORS[each.decision])
        key = (f"{label(found, each.run)} against A", each.run) if runs > 1 else key
        groups.setdefault(key, []).append(each)
    for (name, color), group in groups.items():
        shift = (group[0].run - 0.5 * (runs + 1)) * _APART / max(runs - 1, 1)
        y = np.array([rows.index((each.quantity, each.figure)) + shift for each in group])
        percents = [(each.relative, each.relative_low, each.relative_high) for each in group]
        middle, low, high = 100.0 * np.array(percents).T
        titles = tuple(" | ".join(row[:-1]) for row in figure_table(found, group).rows)
        layers.append(
            Points(name, middle, y, low, high, True, size=7.0, color=color, titles=titles)
        )
    columns: tuple[tuple[str, tuple[str, ...]], ...] = ()
    if runs == 1:
        cells = zip(*map(texts, differences), strict=True)
        columns = tuple(zip(("A", "B", "difference", "95 % interval"), cells, strict=True))
    names = tuple(f"{shown(name).label}, {FIGURES[figure]}" for name, figure in rows)
    return Plot(
        "Differences from A, with 95 % intervals",
        tuple(layers),
        f"{_differing(found, number)} of {len(differences)} figures differ from A.",
        y=Axis(categories=names, flipped=True, columns=columns),
        x=Axis("difference", "%"),
        height=(_ROW + 7 * (runs - 1)) * len(rows),
        width=1068,
    )


def distribution_plots(found: Comparison, number: int) -> Iterator[Plot]:
    """Yield a histogram of each quantity of all runs in a window.

    There is none of a constant, and of a quantity that is averaged over the time.
    """
    window = found.windows[number]
    for quantity in QUANTITIES:
        if quantity.averaged or quantity.name not in found.figures[number]:
            continue
        spans = zip(found.values, window.begins, window.ends, strict=True)
        series = [series_of(run, quantity, *span) for run, *span in spans]
        if plot := _distribution(
            found, quantity, [np.empty(0) if s is None else s for s in series]
        ):
            yield plot


def _distribution(
    found: Comparison, quantity: ComparedQuantity, series: Sequence[np.ndarray]
) -> Plot | None:
    together = np.concatenate(series)
    if not len(together) or not float(together.max()) > float(together.min()):
        return None
    low, high = np.quantile(together, [_TAIL, 1.0 - _TAIL])
    if not high > low * (1.0 + 1e-6):
        low, high = float(together.min()), float(together.max())
    log = low > 0.0 and high > low * _DECADES
    edges = np.geomspace(low, high, _CLASSES + 1) if log else np.linspace(low, high, _CLASSES + 1)
    if not (np.diff(edges) > 0.0).all():
        return None
    unit = shown(quantity.name)
    layers, medians = [], []
    for number, values in enumerate(series):
        if len(values):
            shares = 100.0 * np.histogram(values, edges)[0] / len(values)
            x, y = np.append(edges, edges[-1]), np.concatenate([shares, shares[-1:], [0.0]])
            name = label(found, number)
            layers.append(Line(name, x * unit.scale, y, True, number))
            medians.append(f"{found.letters[number]} {unit.text(float(np.median(values)))}")
    axis = Axis("", unit.unit, log=log, low=low * unit.scale, high=high * unit.scale)
    title = f"{unit.label} [{unit.unit}], share in each class [%]"
    alt = f"Medians: {', '.join(medians)}."
    return Plot(title, tuple(layers), alt, Axis(low=0.0), axis, 130, 340)
