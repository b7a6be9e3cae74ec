"""Findings of a reproduction as sentences and rows of tables, for report and validation.md."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rpud_sim.model.parameters import CONTACT_MODELS
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS, Number
from rpud_sim.studies.reproduction.parameter_studies import CLAIMS, OUTPUTS
from rpud_sim.studies.reproduction.readings import Fit, Value, nearest_fit, not_reproduced
from rpud_sim.studies.reproduction.reproduction import (
    BEST,
    PRESETS,
    Reproduction,
    figure_12_implies,
)

SOURCES = {"section": "Section IV", "abstract": "abstract", "conclusion": "conclusion"}
CHOICES = ("vibration_amplitude", "weight_on_bit", "elastic_modulus", "contact_model", "count")

Row = tuple[str, ...]


def plain(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent if it is moderate."""
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def show(value: float, unit: str) -> str:
    """Return a quantity in a fitting unit, such as 42 µm for 4.2e-5 m."""
    if unit == "m":
        return f"{plain(1e6 * value)} µm" if value < 1e-3 else f"{plain(1e3 * value)} mm"
    if unit == "s":
        return f"{plain(1e6 * value)} µs"
    return f"{plain(value)} {unit}".rstrip()


def show_mean(value: Value, number: Number) -> str:
    """Return mean and 95 % interval of the mean as text."""
    mean = show(value.mean, number.unit)
    return f"{mean} ± {show(1.96 * value.standard_error, number.unit)}"


def show_value(value: Value, number: Number) -> str:
    """Return mean, 95 % interval of the mean, and range of 95 % of single runs as text."""
    if value.low == value.high:
        return show(value.mean, number.unit)
    runs = f"{show(value.low, number.unit)} to {show(value.high, number.unit)}"
    return f"{show_mean(value, number)} (runs: {runs})"


def summary(result: Reproduction) -> list[str]:
    """Return the main findings, one sentence or two each."""
    best, presets = result.best, result.presets
    missing = [entry["key"] for entry in not_reproduced(result.fits)]
    low, high = best.misfit_interval
    rivals = sum(fit.misfit_interval[0] <= high for fit in result.fits) - 1
    simulated = min(result.fits, key=lambda fit: fit.misfit_simulated)
    most = max(result.fits, key=lambda fit: (fit.near, -fit.misfit))
    slope, half = result.slope(BEST)
    lines = [
        f"Of {len(result.fits)} readings, the one that fits all {len(NUMBERS)} numbers best is: "
        f"{best.reading}. Its misfit is {best.misfit:.2f} [{low:.2f}, {high:.2f}], that is, the "
        f"model is typically off by a factor of {np.exp(best.misfit):.1f}. It reproduces within "
        f"10 %: {_reproduced(best)}. {rivals} other readings have an interval that reaches as low.",
        f"The presets ({presets.reading}) have a misfit of {presets.misfit:.2f} and reproduce "
        f"within 10 %: {_reproduced(presets)}.",
        f"Over the {sum(not n.measured for n in NUMBERS)} simulated numbers alone the best reading "
        f"is: {simulated.reading}, with {simulated.misfit_simulated:.2f}.",
        f"Most numbers within 10 % has: {most.reading}, namely {_reproduced(most)}; its misfit is "
        f"{most.misfit:.2f}.",
        f"No reading reproduces within 10 %: {', '.join(missing) or 'none is left'}.",
    ]
    for drill in (PRESETS, BEST):
        agree = sum(row[-1] == "yes" for row in trend_rows(result, drill))
        lines.append(
            f"Trends of Figs. 15-18 ({drill}): {agree} of 16 agree with Section IV."
            f"{_disagreements(result, drill)}"
        )
    lines.append(
        "Fig. 23: the reacting force rises with the weight on bit in the model as it does in the "
        f"measurement, by {slope:.3f} ± {half:.3f} N per N ({BEST})."
    )
    lines.append(_damping_finding(result))
    lines.append(_bar_finding(result))
    return lines


def _reproduced(fit: Fit) -> str:
    near = [number.key for number in NUMBERS if fit.values[number.key].near(number)]
    return ", ".join(near) or "none"


def _disagreements(result: Reproduction, drill: str) -> str:
    rows = [row for row in trend_rows(result, drill) if row[-1] != "yes"]
    if not rows:
        return ""
    return (
        " It differs on: "
        + "; ".join(f"{row[1]} over {row[0]} ({row[2]}, Section IV: {row[6]})" for row in rows)
        + "."
    )


def _damping_finding(result: Reproduction) -> str:
    parts = []
    for row in trend_rows(result, PRESETS):
        if row[0] == "rpud_damping_ratio" and row[7] != "-":
            claims = zip(SOURCES.values(), row[6:9], strict=True)
            said = ", ".join(f"{name} {claim}" for name, claim in claims)
            parts.append(f"{row[1]} {row[2]} ({row[3]}) in the model; {said}")
    return "On the damping ratio the paper contradicts itself: " + ". ".join(parts) + "."


def _bar_finding(result: Reproduction) -> str:
    parts = []
    for model in CONTACT_MODELS:
        ranges = []
        for name in ("peak_force", "peak_displacement", "duration", "restitution"):
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


def number_rows(result: Reproduction) -> list[Row]:
    """Return for each number the row under ``HEADINGS["numbers"]``."""
    rows: list[Row] = []
    for number in NUMBERS:
        near = sum(fit.values[number.key].near(number) for fit in result.fits)
        nearest = nearest_fit(result.fits, number)
        rows.append(
            (
                number.key,
                number.source,
                number.statement,
                show(number.paper, number.unit),
                show_value(result.presets.values[number.key], number),
                show_value(result.best.values[number.key], number),
                f"{near} of {len(result.fits)}",
                f"{show(nearest.values[number.key].mean, number.unit)} "
                f"({nearest.reading.describe(number.regime)})",
            )
        )
    return rows


def missing_rows(result: Reproduction) -> list[Row]:
    """Return for each number that no reading reproduces: key, paper, nearest, its reading."""
    units = {number.key: number.unit for number in NUMBERS}
    return [
        (
            entry["key"],
            show(entry["paper"], units[entry["key"]]),
            show(entry["nearest"], units[entry["key"]]),
            entry["reading"],
        )
        for entry in not_reproduced(result.fits)
    ]


def ranking_rows(result: Reproduction) -> list[Row]:
    """Return for each reading, the best first: ``HEADINGS["ranking"]``, then every mean."""
    return [
        (
            str(rank),
            *(_choice(fit.reading, name) for name in CHOICES),
            f"{fit.misfit:.3f} [{fit.misfit_interval[0]:.3f}, {fit.misfit_interval[1]:.3f}]",
            f"{fit.misfit_simulated:.3f}",
            f"{fit.misfit_measured:.3f}",
            str(fit.near),
            *(show_mean(fit.values[number.key], number) for number in NUMBERS),
        )
        for rank, fit in enumerate(result.fits, 1)
    ]


def choice_rows(result: Reproduction) -> list[Row]:
    """Return for each choice alone: name, value, and the least misfit of any reading with it."""
    rows: list[Row] = []
    for name in CHOICES:
        for value in sorted({getattr(fit.reading, name) for fit in result.fits}):
            fits = [fit for fit in result.fits if getattr(fit.reading, name) == value]
            rows.append((name, _choice(fits[0].reading, name), f"{fits[0].misfit:.3f}"))
    return rows


def _choice(reading: Any, name: str) -> str:
    value = getattr(reading, name)
    return value if isinstance(value, str) else f"{value:g}"


def trend_rows(result: Reproduction, drill: str) -> list[Row]:
    """Return for each trend the row under ``HEADINGS["trends"]``."""
    rows: list[Row] = []
    for trend in result.trends[drill]:
        place = OUTPUTS.index(trend.output)
        claims = [CLAIMS[trend.parameter][source][place] or "-" for source in SOURCES]
        rows.append(
            (
                trend.parameter,
                trend.output,
                trend.verdict + (", and turns" if trend.turns else ""),
                f"{100.0 * trend.change:+.1f} ± {100.0 * trend.change_interval:.1f} %",
                f"{trend.tau:+.2f}",
                f"{trend.p_value:.1e}",
                *claims,
                "yes" if claims[0] == trend.verdict else "no",
            )
        )
    return rows


def bar_rows(result: Reproduction) -> list[Row]:
    """Return for each blow the row under ``HEADINGS["bar"]``."""
    rows: list[Row] = []
    for item in (*result.bar.by_mass, *result.bar.by_speed):
        row = [show(1e3 * item.free_mass, "g"), show(item.impact_velocity, "m/s")]
        for name, unit in (
            ("peak_force", "N"),
            ("peak_displacement", "m"),
            ("duration", "s"),
            ("restitution", ""),
        ):
            bar = getattr(item.bar, name)
            row.append(show(bar, unit))
            for model in ("printed", "rayleigh"):
                value = getattr(item.contacts[model], name)
                row.append(f"{show(value, unit)} (×{plain(value / bar, 2)})")
        rows.append(tuple(row))
    return rows


def mesh_rows(result: Reproduction) -> list[Row]:
    """Return for each mesh the row under ``HEADINGS["mesh"]``."""
    return [
        (
            str(elements),
            show(bar.peak_force, "N"),
            show(bar.peak_displacement, "m"),
            show(bar.duration, "s"),
            plain(bar.restitution),
            show(bar.touching, "s"),
            f"{bar.energy_error:.1e}",
        )
        for elements, bar in result.bar.by_elements.items()
    ]


def tool_rows(result: Reproduction) -> list[Row]:
    """Return rows with the tool that Fig. 12 implies, and with those of both contact models."""
    implied = figure_12_implies()
    rows = [("implied by Fig. 12", implied["tool_mass"], implied["tool_spring_rate"])]
    contacts = result.bar.by_speed[0].contacts
    rows += [(name, tool.tool_mass, tool.tool_spring_rate) for name, tool in contacts.items()]
    return [(name, f"{1e3 * mass:.2f} g", f"{rate:.3g} N/m") for name, mass, rate in rows]


def effort_text(result: Reproduction) -> str:
    """Return the amount of simulation in one line."""
    return ", ".join(f"{name} {value}" for name, value in dataclasses.asdict(result.effort).items())
