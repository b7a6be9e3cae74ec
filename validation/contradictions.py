"""Places where the paper contradicts itself, each with what the model gives."""

from __future__ import annotations

from rpud_sim.model.contact import effective_tool, single_contact
from rpud_sim.simulation import preset
from validation.choices import SHAPE_MASS, figure_12_implies, with_tool
from validation.named_choices import (
    AS_FIGURE_12,
    AS_FIGURE_12_PRINTED_AMPLITUDE,
    FITTED,
    ONE_AMPLITUDE,
    REASONED,
    TABLES,
)
from validation.paper_numbers import CONTACT_SPEED, SIMULATED
from validation.results import Results
from validation.wording import plain, show

Row = tuple[str, ...]


def contradiction_rows(results: Results) -> list[Row]:
    """Return for each contradiction: where, one statement, another, and what the model gives.

    It needs the fits of all named choices, and both studies.
    """
    damping = "rpud_damping_ratio"
    return [
        (
            "Tables 1 and 2: A_0 = 35 µm",
            "“amplitude”, for both sections",
            "Figs. 3 and 5 fit 35 µm; Figs. 8, 10, 11, 13 and 14 fit about half, as if 35 µm were "
            "peak to peak",
            _amplitude(results),
        ),
        (
            "Fig. 12 and Table 2",
            "1650 N and 42 µm at 5 m/s",
            "Table 2 with (20)-(36) as printed",
            f"{_blow('printed')} with steel, {_blow('printed, E printed')} with E_dt as printed",
        ),
        (
            "(22) and (24)",
            "the shape (24) has f(L_1) = k_2/(k_1 + k_2)",
            "one term of (22) follows from that shape, the other from the opposite one",
            _masses(),
        ),
        (
            "(27) and Fig. 7(b)",
            "(27) = (k_1² - k_1 k_2 + k_2²)/(k_1 + k_2)",
            "two springs in series give k_1 k_2/(k_1 + k_2)",
            f"{_rate('printed'):.4g} against {_rate('rayleigh'):.4g} N/m; Fig. 12 implies "
            f"{figure_12_implies()[1]:.4g} N/m",
        ),
        (
            "Table 2: E_dt",
            "1.96e9 Pa",
            "steel, with its density of 7.9e3 kg/m³, has about 1.96e11 Pa",
            f"two springs in series have {_rate('rayleigh, E printed'):.4g} N/m with the first, "
            f"{_rate('rayleigh'):.4g} N/m with the second",
        ),
        (
            "Tables 1 and 2: mass of the tool",
            "Table 1 gives 13.5 g",
            "Table 2's sections weigh "
            f"{plain(_section_mass())} g together; their shape (24) counts {1e3 * SHAPE_MASS:g} g",
            _before(results),
        ),
        (
            "Table 2, Fig. 18: weight on bit",
            "Table 2 has none",
            "Fig. 18 sweeps it, and no equation contains it",
            f"the mean reacting force is {_reacting(results, TABLES)} with 10 N ({TABLES}) and "
            f"{_reacting(results, AS_FIGURE_12)} with 8 N ({AS_FIGURE_12}); the paper has 14 N",
        ),
        (
            "Fig. 17: contact force over the damping ratio",
            "Section IV: little effect",
            "abstract: rises with less damping; conclusion: rises with more damping",
            _trend(results, damping, "contact_force_mean"),
        ),
        (
            "Fig. 17: kinetic energy over the damping ratio",
            "Section IV and conclusion: rises with more damping",
            "abstract: rises with less damping",
            _trend(results, damping, "kinetic_energy_rate"),
        ),
        (
            "Fig. 17: letters",
            "caption: (c) kinetic energy, (d) reacting force",
            "Section IV: Fig. 17(c) for the reacting force, Fig. 17(d) for the kinetic energy",
            "the letters of the text are swapped; the caption is that of Figs. 15, 16 and 18",
        ),
        (
            "Fig. 18: contact force over the weight on bit",
            "Section IV: little effect",
            "abstract and conclusion: rises",
            _trend(results, "weight_on_bit", "contact_force_mean"),
        ),
        (
            "Figs. 20 and 21",
            "captions: before rock drilling",
            "text: “during rock drilling”",
            "compared with the model before drilling: there the tool moves millimetres, in the "
            "rock micrometres",
        ),
        (
            "Fig. 13: “kinetic energy transferred”",
            "12.4 J in 0.6 s",
            "no definition: the energy that arrives, the common motion after (21), or what the "
            "free mass leaves behind",
            _energies(results),
        ),
    ]


def _blow(tool: str) -> str:
    contact = single_contact(with_tool(tool), CONTACT_SPEED)
    return f"{show(contact.peak_force, 'N')} and {show(contact.peak_displacement, 'm')}"


def _rate(tool: str) -> float:
    return effective_tool(with_tool(tool)).spring_rate


def _masses() -> str:
    masses = {
        name: 1e3 * effective_tool(with_tool(name)).mass
        for name in ("printed", "rayleigh", "mode_shape")
    }
    return (
        f"(22) as printed {masses['printed']:.3f} g, with the shape (24) "
        f"{masses['mode_shape']:.3f} g, with the opposite one {masses['rayleigh']:.3f} g; "
        "Fig. 12 implies "
        f"{1e3 * figure_12_implies()[0]:.2f} g"
    )


def _section_mass() -> float:
    drill = preset("drilling")
    volume = (
        drill.section_1_area * drill.section_1_length
        + drill.section_2_area * drill.section_2_length
    )
    return 1e3 * drill.drill_tool_density * volume


def _amplitude(results: Results) -> str:
    one, printed, fitted = (
        results.fit(name).near() for name in (ONE_AMPLITUDE, AS_FIGURE_12_PRINTED_AMPLITUDE, FITTED)
    )
    return (
        f"numbers within 10 %: {one} of 10 with one A, e_1 and g for both; {printed} of 10 with "
        f"35 µm in both and e_1 = 0.4 in the rock; {fitted} of 10 with two amplitudes"
    )


def _before(results: Results) -> str:
    parts = []
    for name in (TABLES, AS_FIGURE_12):
        fit = results.fit(name)
        rate, force = (fit.values[number].mean for number in SIMULATED[:2])
        parts.append(
            f"{1e3 * fit.choices.before.drill_tool_mass:g} g ({name}): {0.6 * rate:.0f} impacts "
            f"in 0.6 s, {force:.1f} N"
        )
    return f"{'; '.join(parts)}; paper: 260 and 5.8 N"


def _reacting(results: Results, name: str) -> str:
    number = next(number for number in SIMULATED if number.label == "Fig. 14")
    return show(results.fit(name).values[number].mean, "N")


def _trend(results: Results, parameter: str, output: str) -> str:
    parts = []
    for drill in (TABLES, FITTED):
        trend = next(
            item
            for item in results.trends[drill]
            if (item.parameter, item.output) == (parameter, output)
        )
        parts.append(f"{trend.verdict} ({100.0 * trend.change:+.1f} %, {drill})")
    return "; ".join(parts)


def _energies(results: Results) -> str:
    parts = []
    for fit in (results.fit(AS_FIGURE_12), results.fit(REASONED)):
        energies = fit.energies()
        meanings = ", ".join(f"{name} {show(energy, 'J')}" for name, energy in energies.items())
        parts.append(f"{fit.choices.name}: {meanings}")
    return "; ".join(parts)
