"""The page docs/explanation/validation.md, and the tables beside it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jinja2 import Environment, StrictUndefined

from rpud_sim.model.contact import effective_tool, single_contact
from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.simulation import preset
from validation import choices
from validation.choices import AS_FIGURE_12, FITTED, REASONED, TABLES, TOOLS, with_tool
from validation.elastic_bar import BarImpact
from validation.numbers import (
    CONTACT_SPEED,
    FIGURE_12,
    MEASURED,
    NUMBERS,
    SIMULATED,
    Number,
    plain,
    show,
)
from validation.scores import Fit, Results, Value
from validation.trends import CLAIMS, OUTPUTS, Trend

_TEMPLATES = Environment(undefined=StrictUndefined, keep_trailing_newline=True)
_FOLDER = Path(__file__).parent


class Table(NamedTuple):
    """Heading and rows of a table."""

    heading: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        lines = [self.heading, ["---"] * len(self.heading), *self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def csv(self) -> str:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([self.heading, *self.rows])
        return text.getvalue()


def score_table(results: Results, names: Sequence[str] = ()) -> Table:
    """Return model over paper for each simulated number and set of choices, by default all."""
    heading = ["choices", *(number.label for number in SIMULATED), "within 10 %", "misfit"]
    rows = [
        [
            fit.choices.name,
            *(_ratio(fit, number) for number in SIMULATED),
            f"{fit.near()} of {len(SIMULATED)}",
            f"{fit.misfit():.2f}",
        ]
        for fit in results.fits
        if not names or fit.choices.name in names
    ]
    return Table(heading, rows)


def _ratio(fit: Fit, number: Number) -> str:
    value = fit.values[number]
    ratio = value.over(number)
    text = f"{ratio:.2f}" if ratio < 10.0 else plain(ratio)
    return f"**{text}**" if value.near(number) else text


def choice_table(results: Results) -> Table:
    """Return the values of each set of choices, and their reasons."""
    sets = [fit.choices for fit in results.fits]
    rows = [[own.name, str(own.before), str(own.rock), own.reasons] for own in sets]
    return Table(["choices", "before drilling", "in the rock", "reasons"], rows)


def number_table(results: Results) -> Table:
    """Return the paper's numbers beside the model's, with intervals."""
    names = (TABLES, REASONED, AS_FIGURE_12, FITTED)
    rows = [
        [
            number.label,
            number.statement,
            show(number.paper, number.unit),
            *(_interval(results.fit(name).values[number], number.unit) for name in names),
        ]
        for number in NUMBERS
    ]
    return Table(["figure", "what it is", "paper", *names], rows)


def _interval(value: Value, unit: str) -> str:
    mean = show(value.mean, unit)
    if value.low == value.high:
        return mean
    factor = 1e3 if unit == "m" else 1.0  # millimetres, as the mean
    parts = ((value.half_interval, 2), (value.low, 3), (value.high, 3))
    half, low, high = (plain(factor * each, digits) for each, digits in parts)
    return f"{mean} ± {half} ({low} to {high})"


def measured_table(results: Results) -> Table:
    """Return model over paper for the measured numbers, each drill once."""
    rows = {
        (before := str(fit.choices.before)): [before, *(_ratio(fit, each) for each in MEASURED)]
        for fit in results.fits
    }
    return Table(["before drilling", *(number.label for number in MEASURED)], list(rows.values()))


def tool_table(_: Results | None = None) -> Table:
    """Return each tool in the rock, and the tool that Fig. 12 implies."""

    def row(name: str, meaning: str, mass: float, rate: float, *blow: str) -> list[str]:
        return [name, meaning, f"{1e3 * mass:.3f} g", f"{rate:.4g} N/m", *blow]

    rows = [
        row(name, meaning, *effective_tool(with_tool(name)), *_blow(name))
        for name, (meaning, _) in TOOLS.items()
    ]
    implied = "Fig. 12, and what it implies by (21), (30) and (36) without gravity"
    numbers = (show(number.paper, number.unit) for number in FIGURE_12)
    rows.append(row("paper", implied, *choices.figure_12_implies(), *numbers))
    heading = ["tool", "meaning", "effective mass", "effective spring rate"]
    return Table([*heading, "force at 5 m/s", "displacement at 5 m/s"], rows)


def _blow(tool: str) -> tuple[str, str]:
    contact = single_contact(with_tool(tool), CONTACT_SPEED)
    return show(contact.peak_force, "N"), show(contact.peak_displacement, "m")


def contradiction_table(results: Results) -> Table:
    """Return where the paper contradicts itself, and what the model gives."""
    drill = preset("drilling")
    volume = drill.section_1_area * drill.section_1_length
    volume += drill.section_2_area * drill.section_2_length
    reacting = next(number for number in SIMULATED if number.label == "Fig. 14")

    def before(name: str) -> str:
        fit = results.fit(name)
        rate, force = (fit.values[number].mean for number in SIMULATED[:2])
        grams = f"{1e3 * fit.choices.before.drill_tool_mass:g} g ({name})"
        return f"{grams}: {0.6 * rate:.0f} impacts in 0.6 s, {force:.1f} N"

    def trend(*wanted: str) -> str:
        found = ((name, t) for name, trends in results.trends.items() for t in trends)
        return "; ".join(
            f"{t.verdict} ({100.0 * t.change:+.1f} %, {name})"
            for name, t in found
            if (t.parameter, t.output) == wanted
        )

    def energies(name: str) -> str:
        found = results.fit(name).energies().items()
        return f"{name}: " + ", ".join(f"{meaning} {show(each, 'J')}" for meaning, each in found)

    names = {
        **vars(choices),
        "fit": results.fit,
        "blow": lambda tool: " and ".join(_blow(tool)),
        "mass": lambda tool: f"{1e3 * effective_tool(with_tool(tool)).mass:.3f}",
        "rate": lambda tool: f"{effective_tool(with_tool(tool)).spring_rate:.4g}",
        "implied": choices.figure_12_implies(),
        "section_mass": plain(1e3 * drill.drill_tool_density * volume),
        "reacting": lambda name: show(results.fit(name).values[reacting].mean, "N"),
        "before": before,
        "trend": trend,
        "energies": energies,
    }
    with (_FOLDER / "contradictions.csv").open(newline="", encoding="utf-8") as file:
        heading, *rows = csv.reader(file)
    make = _TEMPLATES.from_string
    return Table(heading, [[make(cell).render(names) for cell in row] for row in rows])


def trend_table(results: Results) -> Table:
    """Return the verdicts on Figs. 15 to 18 beside the paper's three statements."""
    sources = ("section", "abstract", "conclusion")
    rows = []
    for pair in zip(results.trends[TABLES], results.trends[FITTED], strict=True):
        parameter, output = pair[0].parameter, pair[0].output
        claims = [CLAIMS[parameter][source][OUTPUTS.index(output)] or "-" for source in sources]
        verdicts = [
            f"{each.verdict}, {100.0 * each.change:+.1f} ± {100.0 * each.change_interval:.1f} %"
            for each in pair
        ]
        rows.append([parameter, output, *verdicts, *claims])
    heading = ["parameter", "output", TABLES, FITTED, "Section IV", "abstract", "conclusion"]
    return Table(heading, rows)


def bar_table(results: Results) -> Table:
    """Return the results of the bar beside the energy balance, by free mass."""
    rows = []
    quantities = ("displacement", "m"), ("contact time", "s"), ("restitution", "")
    names = "peak_displacement", "duration", "restitution"
    for (quantity, unit), name in zip(quantities, names, strict=True):
        for item in results.bar:
            bar = getattr(item.bar, name)
            values = [getattr(item.balances[model], name) for model in CONTACT_MODELS]
            ratios = [f"{show(value, unit)} (×{plain(value / bar, 2)})" for value in values]
            rows.append([quantity, show(1e3 * item.free_mass, "g"), show(bar, unit), *ratios])
    return Table(["quantity", "free mass", "bar", *CONTACT_MODELS], rows)


def mesh_table(results: Results) -> Table:
    """Return the convergence of the bar."""
    rows = [
        [f"{elements}", show(bar.peak_displacement, "m"), show(bar.duration, "s"),
         f"{bar.energy_error:.1e}"]
        for elements, bar in results.meshes.items()
    ]  # fmt: skip
    return Table(["elements in part I", "displacement", "contact time", "energy error"], rows)


# Files beside the page, by name, with what they hold.
FILES: Mapping[str, tuple[str, Callable[[Results], Table]]] = {
    "scores": ("model over paper for every set of choices", score_table),
    "numbers": ("the model's values with 95 % intervals and the range of runs", number_table),
    "choices": ("each set of choices and its reasons", choice_table),
    "measured": ("the paper's measured numbers, model over paper", measured_table),
    "tools": ("effective mass and spring rate of the drill tool, and one blow", tool_table),
    "contradictions": ("where the paper contradicts itself", contradiction_table),
    "trends": ("Figs. 15 to 18: model, Section IV, abstract and conclusion", trend_table),
    "bar": ("the energy balance (21) compared with an elastic bar", bar_table),
    "mesh": ("convergence of the bar with its mesh", mesh_table),
}


def page(results: Results) -> str:
    """Return the page; ``FILES`` are beside it."""
    mass = preset("drilling").free_mass

    def outside(name: str) -> list[str]:
        values = results.fit(name).values
        return [
            f"{n.label} ({show(values[n].mean, n.unit)}, paper {show(n.paper, n.unit)})"
            for n in SIMULATED
            if not values[n].near(n)
        ]

    def claim(trend: Trend) -> str:
        return CLAIMS[trend.parameter]["section"][OUTPUTS.index(trend.output)]

    def kept(blow: BarImpact) -> str:
        share = 100.0 * (1.0 - blow.restitution * blow.restitution)
        return f"{blow.restitution:.2f} ({share:.0f} %)"

    def slope(name: str) -> str:
        study = next(each for each in results.studies[name] if each.parameter == "weight_on_bit")
        value, half = study.slope("reacting_force_mean")
        return f"{value:.3f} ± {half:.3f} N per N ({name})"

    missing = (n for n in NUMBERS if not any(fit.values[n].near(n) for fit in results.fits))
    files = [(f"[{name}](validation/{name}.csv)", content) for name, (content, _) in FILES.items()]
    template = (_FOLDER / "page.md").read_text(encoding="utf-8")
    return _TEMPLATES.from_string(template).render(
        vars(choices),
        total=len(SIMULATED),
        effort=results.effort,
        fit=results.fit,
        factor=math.exp(results.fit(TABLES).misfit()),
        outside=outside,
        missing=", ".join(number.label for number in missing) or "none",
        trends=results.trends[FITTED],
        different=[each for each in results.trends[FITTED] if each.verdict != claim(each)],
        claim=claim,
        mass=show(1e3 * mass, "g"),
        blow=next(item for item in results.bar if item.free_mass == mass),
        kept=kept,
        slopes=", ".join(map(slope, results.studies)),
        scores=score_table(results, (FITTED, REASONED, TABLES)).markdown(),
        files=Table(["file", "content"], files).markdown(),
    )
