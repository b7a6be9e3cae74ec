"""Findings of a reproduction as sentences, for the command, the report and validation.md."""

from __future__ import annotations

import dataclasses

import numpy as np

from rpud_sim.model.parameters import CONTACT_MODELS
from rpud_sim.studies.reproduction.named_readings import (
    AS_FIGURE_12,
    AS_FIGURE_12_PRINTED_AMPLITUDE,
    PRESETS,
    REASONED,
)
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS, SIMULATED
from rpud_sim.studies.reproduction.reproduction import BEST, Reproduction
from rpud_sim.studies.reproduction.rows import trend_rows
from rpud_sim.studies.reproduction.scores import Fit, not_reproduced
from rpud_sim.studies.reproduction.wording import plain, show


def summary(result: Reproduction) -> list[str]:
    """Return the main findings, one sentence or two each."""
    total = len(SIMULATED)
    lines = [_reached(result.best, f"Of {len(result.fits)} readings, the best is ")]
    for name in (AS_FIGURE_12, REASONED):
        lines.append(_reached(result.fit(name), ""))
    presets = result.presets
    lines.append(
        f"The presets reproduce {presets.near()} of {total} within 10 %; the model is typically "
        f"off by a factor of {np.exp(presets.misfit):.1f}."
    )
    printed = result.fit(AS_FIGURE_12_PRINTED_AMPLITUDE)
    one = min((fit for fit in result.fits if fit.reading.consistent), key=lambda fit: fit.order)
    lines.append(
        "The paper's 35 µm fits before drilling, and about half of it fits in the rock. With 35 µm "
        f"in both and e_1 = 0.4 in the rock, {printed.near()} of {total} are within 10 %. With one "
        f"amplitude, restitution and gravity for both, the best is “{one.reading.name}”, with "
        f"{one.near()} of {total} within 10 % and a misfit of {one.misfit:.2f} "
        f"({one.reading.before}; {one.reading.rock})."
    )
    missing = ", ".join(entry["key"] for entry in not_reproduced(result.fits))
    lines.append(f"Numbers that no reading reproduces within 10 %: {missing or 'none'}.")
    for drill in (PRESETS, BEST):
        rows = trend_rows(result, drill)
        agree = sum(row[-1] == "yes" for row in rows)
        lines.append(
            f"Trends of Figs. 15-18 ({drill}): {agree} of {len(rows)} agree with Section IV."
            f"{_disagreements(rows)}"
        )
    slope, half = result.slope(BEST)
    lines.append(
        "Fig. 23: the reacting force rises with the weight on bit in the model as it does in the "
        f"measurement, by {slope:.3f} ± {half:.3f} N per N ({BEST})."
    )
    lines.append(_bar_finding(result))
    return lines


def _reached(fit: Fit, opening: str) -> str:
    outside = [
        f"{number.label} ({show(fit.values[number.key].mean, number.unit)}, paper "
        f"{show(number.paper, number.unit)})"
        for number in SIMULATED
        if not fit.values[number.key].near(number)
    ]
    beyond = f" Outside: {', '.join(outside)}." if outside else ""
    return (
        f"{opening}“{fit.reading.name}”: {fit.near()} of {len(SIMULATED)} simulated numbers within "
        f"10 %, misfit {fit.misfit:.3f}. Before drilling: {fit.reading.before}. In the rock: "
        f"{fit.reading.rock}.{beyond}"
    )


def _disagreements(rows: list[tuple[str, ...]]) -> str:
    different = [row for row in rows if row[-1] != "yes"]
    if not different:
        return ""
    return (
        " It differs on: "
        + "; ".join(f"{row[1]} over {row[0]} ({row[2]}, Section IV: {row[6]})" for row in different)
        + "."
    )


def _bar_finding(result: Reproduction) -> str:
    parts = []
    for model in CONTACT_MODELS:
        ranges = []
        for name in ("peak_force", "peak_displacement", "duration"):
            ratios = [
                getattr(item.contacts[model], name) / getattr(item.bar, name)
                for item in result.bar.by_mass
            ]
            ranges.append(f"{name} {plain(min(ratios), 2)} to {plain(max(ratios), 2)}")
        parts.append(f"{model}: {', '.join(ranges)}")
    masses = [1e3 * item.free_mass for item in result.bar.by_mass]
    return (
        f"The energy balance over an elastic bar, for free masses of {plain(min(masses))} to "
        f"{plain(max(masses))} g: {'; '.join(parts)}. Its force misses the bar's first wave: "
        "eq. (21) gives the tool's effective mass its velocity in no time, by an impulse that "
        "appears in no contact force."
    )


def captioned_values(result: Reproduction, keys: tuple[str, ...]) -> list[str]:
    """Return for presets and best reading a line with some numbers beside the paper's.

    Args:
        keys: of the numbers; none gives no line.
    """
    numbers = [number for number in NUMBERS if number.key in keys]
    share = "drilling_contact_force_low" in keys
    return [
        f"{drill}: "
        + "; ".join(
            f"{number.label} {show(fit.values[number.key].mean, number.unit)} "
            f"(paper {show(number.paper, number.unit)}, ×{fit.values[number.key].over(number):.2f})"
            for number in numbers
        )
        + (f"; {_share(result, fit)} of the forces from 400 to 2200 N" if share else "")
        for drill, fit in (
            (PRESETS, result.presets),
            (f"best: {result.best.reading.name}", result.best),
        )
        if numbers
    ]


def _share(result: Reproduction, fit: Fit) -> str:
    return f"{100.0 * result.extras[fit.reading.name]['contact_force_share']:.0f} %"


def effort_text(result: Reproduction) -> str:
    """Return the amount of simulation in one line."""
    effort = ", ".join(
        f"{name} {value}" for name, value in dataclasses.asdict(result.effort).items()
    )
    search = result.search
    return f"{effort}; the search made {search.runs} runs and compared {search.compared} sets"
