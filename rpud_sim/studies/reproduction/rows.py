"""Rows of the tables of report and validation.md."""

from __future__ import annotations

import dataclasses

from rpud_sim.model.parameters import CONTACT_MODELS
from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.choices import TOOLS
from rpud_sim.studies.reproduction.named_readings import NAMED
from rpud_sim.studies.reproduction.paper_numbers import (
    CONTACT_SPEED,
    GROUPS,
    MEASURED,
    NUMBERS,
    SIMULATED,
    Number,
)
from rpud_sim.studies.reproduction.parameter_studies import CLAIMS, OUTPUTS
from rpud_sim.studies.reproduction.reproduction import Reproduction, figure_12_implies
from rpud_sim.studies.reproduction.scores import CLOSE, NEAR, Fit, Value, nearest_fit
from rpud_sim.studies.reproduction.single_contact import single_contact
from rpud_sim.studies.reproduction.wording import Row, plain, show, show_ratio, show_value

SOURCES = {"section": "Section IV", "abstract": "abstract", "conclusion": "conclusion"}

# The numbers in the order of the table of scores: by group.
SCORED = tuple(number for group in GROUPS.values() for number in group)

BAR_QUANTITIES = {
    "peak force": ("peak_force", "N"),
    "displacement": ("peak_displacement", "m"),
    "contact time": ("duration", "s"),
    "restitution": ("restitution", ""),
}


@dataclasses.dataclass(frozen=True)
class Cell:
    """Cell of a table of scores."""

    text: str  # shown
    # near, close, low, high, far-low, far-high, or empty for a cell without a color
    grade: str = ""

    def __str__(self) -> str:
        return f"**{self.text}**" if self.grade == "near" else self.text


def grade(ratio: float) -> str:
    """Return the grade of model over paper; ``far`` is beyond a factor of 1.5."""
    if abs(ratio - 1.0) <= NEAR:
        return "near"
    if abs(ratio - 1.0) <= CLOSE:
        return "close"
    side = "low" if ratio < 1.0 else "high"
    return side if 1.0 / 1.5 <= ratio <= 1.5 else f"far-{side}"


def _cell(value: Value, number: Number) -> Cell:
    return Cell(show_ratio(value, number), grade(value.over(number)))


def score_rows(result: Reproduction) -> list[tuple[Cell, ...]]:
    """Return for each reading, the best first, the row under ``HEADINGS["scores"]``."""
    return [
        (
            Cell(str(rank)),
            Cell(fit.reading.name),
            Cell("found" if fit.reading.searched else "named"),
            *(_cell(fit.values[number.key], number) for number in SCORED),
            Cell(f"{fit.close_figures} of {len({number.source for number in SIMULATED})}"),
            Cell(f"{fit.near()} of {len(SIMULATED)}"),
            *(Cell(_group_score(fit, name)) for name in GROUPS),
            Cell(f"{fit.misfit:.3f} [{fit.misfit_interval[0]:.3f}, {fit.misfit_interval[1]:.3f}]"),
        )
        for rank, fit in enumerate(result.fits, 1)
    ]


def _group_score(fit: Fit, name: str) -> str:
    return f"{fit.near(GROUPS[name])} of {len(GROUPS[name])} ({fit.group_misfits[name]:.2f})"


def measured_rows(result: Reproduction) -> list[tuple[Cell, ...]]:
    """Return for each reading the row under ``HEADINGS["measured"]``, each drill once."""
    rows: dict[str, tuple[Cell, ...]] = {}
    for fit in result.fits:
        numbers = [_cell(fit.values[number.key], number) for number in MEASURED]
        row = (
            Cell(str(fit.reading.before)),
            *numbers,
            Cell(f"{fit.group_misfits['measured']:.2f}"),
        )
        rows.setdefault(row[0].text, row)
    return list(rows.values())


def choice_rows(result: Reproduction) -> list[Row]:
    """Return for each reading its choices: ``HEADINGS["choices"]``."""
    return [
        (fit.reading.name, str(fit.reading.before), str(fit.reading.rock)) for fit in result.fits
    ]


def reading_rows(fit: Fit) -> list[tuple[Cell, ...]]:
    """Return for each number of one reading the row under ``HEADINGS["reading"]``."""
    rows: list[tuple[Cell, ...]] = []
    for number in SCORED:
        value = fit.values[number.key]
        rows.append(
            (
                Cell(number.label),
                Cell(number.statement),
                Cell(show(number.paper, number.unit)),
                Cell(show_value(value, number)),
                _cell(value, number),
                Cell("yes" if value.near(number) else "no"),
            )
        )
    return rows


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
                f"{show(nearest.values[number.key].mean, number.unit)} ({nearest.reading.name})",
            )
        )
    return rows


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


def bar_tables(result: Reproduction) -> dict[str, list[Row]]:
    """Return for each quantity of a blow at 5 m/s the rows under ``HEADINGS["bar"]``."""
    tables: dict[str, list[Row]] = {}
    for title, (name, unit) in BAR_QUANTITIES.items():
        rows: list[Row] = []
        for item in result.bar.by_mass:
            bar = getattr(item.bar, name)
            values = [getattr(item.contacts[model], name) for model in CONTACT_MODELS]
            rows.append(
                (
                    show(1e3 * item.free_mass, "g"),
                    show(bar, unit),
                    *(f"{show(value, unit)} (×{plain(value / bar, 2)})" for value in values),
                )
            )
        tables[title] = rows
    return tables


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


def tool_rows() -> list[Row]:
    """Return for each tool in the rock, and for Fig. 12, the row under ``HEADINGS["tools"]``."""
    rows: list[Row] = []
    for name, tool in TOOLS.items():
        contact = single_contact(preset("drilling").replace(**tool.changes), CONTACT_SPEED)
        rows.append(
            (
                name,
                tool.meaning,
                f"{1e3 * contact.tool_mass:.3f} g",
                f"{contact.tool_spring_rate:.4g} N/m",
                show(contact.peak_force, "N"),
                show(contact.peak_displacement, "m"),
            )
        )
    implied = figure_12_implies()
    force, displacement = (number for number in NUMBERS if number.regime == "contact")
    rows.append(
        (
            "paper",
            "Fig. 12, and what it implies by (21), (30) and (36) without gravity",
            f"{1e3 * implied['tool_mass']:.3f} g",
            f"{implied['tool_spring_rate']:.4g} N/m",
            show(force.paper, force.unit),
            show(displacement.paper, displacement.unit),
        )
    )
    return rows


def named_fits(result: Reproduction) -> list[Fit]:
    """Return the fits of the named readings, in the order of their list."""
    return [result.fit(reading.name) for reading in NAMED]
