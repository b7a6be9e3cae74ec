"""Tables of the validation: headings and rows of texts."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from rpud_sim.model.contact import single_contact
from rpud_sim.model.contact_models import CONTACT_MODELS
from validation.choices import TOOLS, figure_12_implies, with_tool
from validation.contradictions import contradiction_rows
from validation.named_choices import AS_FIGURE_12, FITTED, REASONED, TABLES
from validation.paper_numbers import CONTACT_SPEED, FIGURE_12, MEASURED, NUMBERS, SIMULATED, Number
from validation.parameter_studies import CLAIMS, OUTPUTS
from validation.results import Results
from validation.scores import Fit, Value
from validation.wording import plain, show


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
    heading = [*(number.label for number in SIMULATED), "within 10 %", "misfit"]
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
    return Table(["choices", *heading], rows)


def _ratio(fit: Fit, number: Number) -> str:
    value = fit.values[number]
    ratio = value.over(number)
    text = f"{ratio:.2f}" if ratio < 10.0 else plain(ratio)
    return f"**{text}**" if value.near(number) else text


def choice_table(results: Results) -> Table:
    """Return the values of each set of choices, and their reasons."""
    rows = [
        [choices.name, str(choices.before), str(choices.rock), " ".join(choices.reasons)]
        for choices in (fit.choices for fit in results.fits)
    ]
    return Table(["choices", "before drilling", "in the rock", "reasons"], rows)


def contradiction_table(results: Results) -> Table:
    """Return where the paper contradicts itself, and what the model gives."""
    return Table(["where", "one statement", "another", "the model"], contradiction_rows(results))


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
    half, low, high = (
        plain(factor * each, digits)
        for each, digits in ((value.half_interval, 2), (value.low, 3), (value.high, 3))
    )
    return f"{mean} ± {half} ({low} to {high})"


def measured_table(results: Results) -> Table:
    """Return model over paper for the measured numbers, each drill once."""
    rows = {
        str(fit.choices.before): [
            str(fit.choices.before),
            *(_ratio(fit, number) for number in MEASURED),
        ]
        for fit in results.fits
    }
    return Table(["before drilling", *(number.label for number in MEASURED)], list(rows.values()))


def tool_table() -> Table:
    """Return each tool in the rock, and the tool that Fig. 12 implies."""
    rows = []
    for name, tool in TOOLS.items():
        contact = single_contact(with_tool(name), CONTACT_SPEED)
        rows.append(
            [
                name,
                tool.meaning,
                *_tool(*contact.tool),
                show(contact.peak_force, "N"),
                show(contact.peak_displacement, "m"),
            ]
        )
    rows.append(
        [
            "paper",
            "Fig. 12, and what it implies by (21), (30) and (36) without gravity",
            *_tool(*figure_12_implies()),
            *(show(number.paper, number.unit) for number in FIGURE_12),
        ]
    )
    heading = ["tool", "meaning", "effective mass", "effective spring rate"]
    return Table([*heading, "force at 5 m/s", "displacement at 5 m/s"], rows)


def _tool(mass: float, spring_rate: float) -> tuple[str, str]:
    return f"{1e3 * mass:.3f} g", f"{spring_rate:.4g} N/m"


def trend_table(results: Results) -> Table:
    """Return the verdicts on Figs. 15 to 18 beside the paper's three statements."""
    sources = ("section", "abstract", "conclusion")
    rows = []
    for tables, fitted in zip(results.trends[TABLES], results.trends[FITTED], strict=True):
        place = OUTPUTS.index(tables.output)
        claims = [CLAIMS[tables.parameter][source][place] or "-" for source in sources]
        verdicts = [
            f"{trend.verdict}, {100.0 * trend.change:+.1f} ± {100.0 * trend.change_interval:.1f} %"
            for trend in (tables, fitted)
        ]
        rows.append([tables.parameter, tables.output, *verdicts, *claims])
    heading = ["parameter", "output", TABLES, FITTED, "Section IV", "abstract", "conclusion"]
    return Table(heading, rows)


def bar_table(results: Results) -> Table:
    """Return the results of the bar beside those of the energy balance, by free mass."""
    rows = []
    for quantity, name, unit in (
        ("displacement", "peak_displacement", "m"),
        ("contact time", "duration", "s"),
        ("restitution", "restitution", ""),
    ):
        for item in results.bar:
            bar = item.bar_restitution if name == "restitution" else getattr(item.bar, name)
            values = [getattr(item.balance(model), name) for model in CONTACT_MODELS]
            ratios = [f"{show(value, unit)} (×{plain(value / bar, 2)})" for value in values]
            rows.append([quantity, show(1e3 * item.free_mass, "g"), show(bar, unit), *ratios])
    return Table(["quantity", "free mass", "bar", *CONTACT_MODELS], rows)


def mesh_table(results: Results) -> Table:
    """Return the convergence of the bar."""
    rows = [
        [
            str(elements),
            show(bar.peak_displacement, "m"),
            show(bar.duration, "s"),
            f"{bar.energy_error:.1e}",
        ]
        for elements, bar in results.meshes.items()
    ]
    return Table(["elements in part I", "displacement", "contact time", "energy error"], rows)


# Files beside the page, by name, with what they hold.
FILES: Mapping[str, tuple[str, Callable[[Results], Table]]] = {
    "scores": ("model over paper for every set of choices", score_table),
    "numbers": ("the model's values with 95 % intervals and the range of runs", number_table),
    "choices": ("each set of choices and its reasons", choice_table),
    "measured": ("the paper's measured numbers, model over paper", measured_table),
    "tools": (
        "effective mass and spring rate of the drill tool, and one blow",
        lambda _: tool_table(),
    ),
    "contradictions": ("where the paper contradicts itself", contradiction_table),
    "trends": ("Figs. 15 to 18: model, Section IV, abstract and conclusion", trend_table),
    "bar": ("the energy balance (21) compared with an elastic bar", bar_table),
    "mesh": ("convergence of the bar with its mesh", mesh_table),
}
