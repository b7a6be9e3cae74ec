"""Page of a comparison: one HTML file in the style of all pages."""

from __future__ import annotations

import os

from rpud_sim.inspection.compare.estimates import DIFFERS, EQUIVALENT, SAME, UNDECIDED, Estimate
from rpud_sim.inspection.compare.page_plots import (
    distribution_plots,
    interval_plot,
    label,
    time_column,
)
from rpud_sim.inspection.compare.quantities import COUNTERS, MEAN, MEDIAN, P95, TIMING
from rpud_sim.inspection.compare.recorded_drill import CompareError
from rpud_sim.inspection.compare.results import Comparison, QuantityComparison, WindowComparison
from rpud_sim.inspection.compare.same_bits import EQUAL, TopicBits, first_different
from rpud_sim.inspection.compare.template import BODY, HEADINGS
from rpud_sim.inspection.output import write_new_file
from rpud_sim.pages.frame import render_page

_UNSET = "–"
_MOST_DRAWN = 3  # windows whose distributions are drawn
_SHOWN_TEXT = 80  # characters of a value of a message


def write_page(found: Comparison, out: str | os.PathLike[str]) -> None:
    write_new_file(out, render(found), CompareError)


def render(found: Comparison) -> str:
    letters = [chr(ord("A") + number) for number in range(len(found.names))]
    drawn = found.windows[:_MOST_DRAWN]
    decisions = [each.decision for each in found.differences]
    tiles = [(text, str(decisions.count(text))) for text in (DIFFERS, SAME, EQUIVALENT, UNDECIDED)]
    return render_page(
        BODY,
        " and ".join(found.names) if len(found.names) < 3 else f"{len(found.names)} runs",
        verdict=f"{found.verdict[0].upper()}{found.verdict[1:]}.",
        tiles=[(f"figures: {text}", value) for text, value in tiles if value != "0"],
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
            **HEADINGS,
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
        windows=[_window(found, window, letters) for window in found.windows],
        distributions=[
            (
                window.window.name,
                [p for q in window.quantities for p in distribution_plots(found, window, q)],
            )
            for window in drawn
        ],
        not_drawn=len(found.windows) - len(drawn),
        over_time=time_column(found),
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


def _window(found: Comparison, window: WindowComparison, letters: list[str]) -> dict[str, object]:
    spans = dict.fromkeys(zip(window.window.begins, window.window.ends, strict=True))
    shown = ", ".join(f"{begin:.6g} to {end:.6g} s" for begin, end in spans)
    rows = []
    for quantity in window.quantities:
        for number, run in enumerate(quantity.differences, 1):
            for each in run:
                rows.append(
                    (
                        quantity.title,
                        each.figure,
                        letters[number],
                        f"{each.reference.value:.5g}",
                        f"{each.other.value:.5g}",
                        quantity.unit,
                        show(each.value),
                        _interval(each.low, each.high),
                        _percent(each.relative),
                        _interval(100.0 * each.relative_low, 100.0 * each.relative_high),
                        show(each.chance, 2),
                        each.decision,
                    )
                )
    return {
        "name": f"{window.window.name}: {shown}",
        "intervals": interval_plot(found, window),
        "rows": rows,
        "of_runs": [row for quantity in window.quantities for row in _values(quantity, letters)],
    }


def _values(quantity: QuantityComparison, letters: list[str]) -> list[tuple[str, ...]]:
    rows = []
    for letter, run in zip(letters, quantity.runs, strict=True):
        if run is None:
            rows.append((quantity.title, quantity.unit, letter, "0", *([_UNSET] * 8)))
            continue
        cells = [
            cell for name in (MEAN, MEDIAN, P95) for cell in _estimate(run.estimates.get(name))
        ]
        rows.append(
            (
                quantity.title,
                quantity.unit,
                letter,
                str(run.count),
                f"{run.estimates[MEAN].blocks:.0f}",
                *cells,
                show(run.greatest),
            )
        )
    return rows


def _estimate(each: Estimate | None) -> tuple[str, str]:
    if each is None:
        return _UNSET, _UNSET
    return show(each.value), _interval(each.low, each.high)


def show(value: float, digits: int = 4) -> str:
    """Return a number with some digits; a dash for NaN."""
    return f"{value:.{digits}g}" if value == value else _UNSET


def _percent(value: float) -> str:
    return f"{100.0 * value:+.3g}" if value == value else _UNSET


def _interval(low: float, high: float) -> str:
    return f"{low:.4g} to {high:.4g}" if low == low and high == high else _UNSET


def _timing_rows(found: Comparison) -> list[tuple[str, ...]]:
    rows = []
    for name, title, unit in TIMING:
        scale, shown = (1e3, " [ms]") if unit == "s" else (1.0, "")
        for kind in ("median", "greatest"):
            cells = [show(scale * getattr(timing, kind)[name]) for timing in found.timing]
            rows.append((f"{title}, {kind}{shown}", *cells))
    for name, title in COUNTERS:
        counts = [timing.counters[name] for timing in found.timing]
        rows.append((title, *(_UNSET if count is None else str(count) for count in counts)))
    return rows
