"""Page of a comparison: one HTML file in the style of all pages."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rpud_sim.foundation.shown_quantities import NONE
from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.frame import Picture, colors, picture, render_page
from rpud_sim.recorded.compare.estimates import (
    DIFFERS,
    EQUIVALENT,
    SAME,
    TOO_FEW,
    UNDECIDED,
    FigureDifference,
)
from rpud_sim.recorded.compare.results import (
    LETTERS,
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_DRAWN = 3  # windows whose distributions are drawn
_CLASSES = 60  # of a histogram
_TAIL = 0.002  # share of values beyond each end of a histogram
_DECADES = 30.0  # greatest over least, above which classes are equal in the logarithm
_WIDE = 400.0  # from here on the axis of the differences is logarithmic above 100 %
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
{% if differences %}{{ figures([differences]) }}{% else %}
<p class="none">There are too few values to compare.</p>{% endif %}
{% for section in sections %}
<details><summary>{{ section.title }}</summary>
{% if section.text %}<p>{{ section.text }}</p>{% endif %}
{% for each in section.tables %}{{ table(each.head, each.rows, caption=each.caption) }}
{% endfor %}
{% if section.pictures %}{{ figures(section.pictures) }}{% endif %}
</details>
{% endfor %}
"""
_METHOD = (
    "Intervals are 95 % confidence intervals from means of batches of values, since impacts that "
    "follow each other are not independent. Decisions are corrected for their number by Holm's "
    "method: if the runs were of one kind, one comparison in twenty would name a difference."
)


class Section(NamedTuple):
    """Part of the page behind a click."""

    title: str
    text: str = ""
    tables: Sequence[ResultTable] = ()
    pictures: Sequence[Picture] = ()


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
        " and ".join(found.names),
        verdict=found.sentence,
        named=[*zip(LETTERS, (drill.path for drill in found.drills), strict=True)],
        settings=f"What differs: {', '.join(texts)}." if texts else "No parameter differs.",
        warnings=[
            *found.warnings,
            *(f"Not compared: {name}: {part}: {reason}" for name, part, reason in parts),
        ],
        differences=difference_picture(found, windows[0]) if windows else None,
        sections=[
            *(_window(found, number, place) for place, number in enumerate(windows)),
            Section("Settings, commands and faults", "", tables),
            Section(
                "Bits",
                "Times count from the beginning of each run.",
                [_bits_table(found)],
            ),
        ],
    )


def figures_of_window(found: Comparison, number: int) -> list[FigureDifference]:
    """Return the differences of a window, by their effect: first those that are sure."""
    found_here = [each for each in found.differences if each.window == number]

    def effect(each: FigureDifference) -> tuple[bool, float]:
        return each.decision == DIFFERS, abs(each.relative) if math.isfinite(each.relative) else 0.0

    return sorted(found_here, key=effect, reverse=True)


def _differing(found: Comparison, number: int) -> int:
    return sum(each.decision == DIFFERS for each in figures_of_window(found, number))


def _window(found: Comparison, number: int, place: int) -> Section:
    window = found.windows[number]
    rows = []
    for name, runs in found.figures[number].items():
        text = shown(name).text
        for letter, run in zip(LETTERS, runs, strict=True):
            cells = [NONE] * 6
            for at, figure in enumerate(run.estimates.values() if run else ()):
                low, high = text(figure.low, unit=False), text(figure.high)
                interval = NONE if NONE in (low, high) else f"{low} to {high}"
                cells[2 * at : 2 * at + 2] = text(figure.value), interval
            count, greatest = (str(run.number), text(run.max)) if run else ("0", NONE)
            rows.append((shown(name).label, letter, count, *cells, greatest))
    head = ["quantity", "run", "values"]
    head += [text for name in FIGURES.values() for text in (name, "interval")]
    differences = figures_of_window(found, number)
    pictures = [difference_picture(found, number) if place else None]
    pictures += distribution_pictures(found, number) if place < _MOST_DRAWN else ()
    return Section(
        f"{window.name[:1].upper()}{window.name[1:]}, {window.spans}: "
        f"{_differing(found, number)} of {len(differences)} figures differ",
        _METHOD,
        [
            figure_table(differences),
            ResultTable("Values of each run with their intervals", (*head, "greatest"), rows),
        ],
        [each for each in pictures if each],
    )


def _bits_table(found: Comparison) -> ResultTable:
    head = ("topic", "bits", "equal", "first difference [s]", "field", "in A", "in B", "note")
    rows = [
        (
            *(each.topic, each.state, str(each.messages)),
            NONE if each.time is None else f"{each.time:.9f}",
            *(text[:80] for text in (each.field, each.reference, each.other, each.note)),
        )
        for each in found.bits
    ]
    return ResultTable(f"B: {bits_line(found.bits)}", head, rows)


def difference_picture(found: Comparison, number: int) -> Picture | None:
    """Return the relative differences of a window with their intervals; None without any."""
    differences = figures_of_window(found, number)
    if not any(math.isfinite(each.relative) for each in differences):
        return None
    # Values beside each row, below their headings.
    beside = [("A", "B", "difference", "95 % interval"), *(texts(each) for each in differences)]

    def draw(axes: Axes) -> None:
        if found.tolerance:
            edge = 100.0 * found.tolerance
            axes.axvspan(-edge, edge, color=colors()["muted"], alpha=0.16, label="tolerance")
        axes.axvline(0.0, color=colors()["text"], linewidth=1.3)
        for decision, color in _COLORS.items():
            rows = [row for row, each in enumerate(differences) if each.decision == decision]
            group = [differences[row] for row in rows]
            ends = [(each.relative, each.relative_low, each.relative_high) for each in group]
            middle, low, high = 100.0 * np.array(ends).reshape(-1, 3).T
            known = np.isfinite(middle)
            if known.any():
                reach = np.array([middle - low, high - middle])[:, known]
                style: dict[str, Any] = {"color": colors()[color], "label": decision}
                style |= {} if decision == DIFFERS else {"markerfacecolor": "none"}
                places = np.array(rows)[known]
                axes.errorbar(middle[known], places, 0, reach, "o", ms=5, capsize=2, **style)
        if max(abs(edge) for edge in axes.get_xlim()) > _WIDE:  # one must not hide all others
            axes.set_xscale("symlog", linthresh=100.0)
            axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        names = [f"{shown(each.quantity).label}, {FIGURES[each.figure]}" for each in differences]
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.set_xlabel("difference [%]")
        place = 0  # of the right end of a column [points]
        for column in zip(*beside, strict=True):
            place += 6 * max(map(len, column)) + 14
            for row, text in enumerate(column):
                axes.annotate(
                    printable(text),
                    (1.0, row - 1.0),
                    (place, 0),
                    axes.get_yaxis_transform(),
                    "offset points",
                    ha="right",
                    va="center",
                )

    alt = f"{_differing(found, number)} of {len(differences)} figures differ from A."
    title = "Differences from A, with 95 % intervals"
    return picture(title, alt, draw, 90 + _ROW * len(differences), 1068)


def distribution_pictures(found: Comparison, number: int) -> Iterator[Picture]:
    """Yield a histogram of each quantity of both runs in a window.

    There is none of a constant, and of a quantity that is averaged over the time.
    """
    window = found.windows[number]
    for quantity in QUANTITIES:
        if quantity.averaged or quantity.name not in found.figures[number]:
            continue
        spans = zip(found.values, window.begins, window.ends, strict=True)
        series = [series_of(run, quantity, *span) for run, *span in spans]
        if drawn := _distribution(quantity, [np.empty(0) if s is None else s for s in series]):
            yield drawn


def _distribution(quantity: ComparedQuantity, series: Sequence[np.ndarray]) -> Picture | None:
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
    held = [(letter, each) for letter, each in zip(LETTERS, series, strict=True) if len(each)]

    def draw(axes: Axes) -> None:
        for letter, values in held:
            shares = 100.0 * np.histogram(values, edges)[0] / len(values)
            axes.stairs(shares, edges * unit.scale, label=letter, linewidth=1.4)
        axes.set_xscale("log" if log else "linear")
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel(f"[{unit.unit}]" if unit.unit else "")

    medians = [f"{letter} {unit.text(float(np.median(each)))}" for letter, each in held]
    title = f"{unit.label} [{unit.unit}], share in each class [%]"
    return picture(title, f"Medians: {', '.join(medians)}.", draw)
