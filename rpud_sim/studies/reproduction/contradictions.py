"""Places where the paper contradicts itself, each with what the model gives."""

from __future__ import annotations

from rpud_sim.model.drill import effective_tool
from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.choices import (
    ENERGIES,
    SHAPE_MASS,
    TOOLS,
)
from rpud_sim.studies.reproduction.named_readings import (
    AS_FIGURE_12,
    AS_FIGURE_12_PRINTED_AMPLITUDE,
    PRESETS,
    REASONED,
)
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED
from rpud_sim.studies.reproduction.reproduction import (
    BEST,
    Reproduction,
    figure_12_implies,
)
from rpud_sim.studies.reproduction.single_contact import single_contact
from rpud_sim.studies.reproduction.wording import Row, plain, show


def contradiction_rows(result: Reproduction) -> list[Row]:
    """Return for each contradiction: where, one statement, another, and what the model gives."""
    damping = "rpud_damping_ratio"
    return [
        (
            "Tables 1 and 2: A_0 = 35 µm",
            "“amplitude”, for both sections",
            "Figs. 3 and 5 fit 35 µm; Figs. 8, 10, 11, 13 and 14 fit about half, as if 35 µm were "
            "peak to peak",
            _amplitude(result),
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
            f"{figure_12_implies()['tool_spring_rate']:.4g} N/m",
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
            _before(result),
        ),
        (
            "Table 2, Fig. 18: weight on bit",
            "Table 2 has none",
            "Fig. 18 sweeps it, and no equation contains it",
            f"the mean reacting force is {_reacting(result, PRESETS)} with 10 N (presets) and "
            f"{_reacting(result, AS_FIGURE_12)} with 8 N ({AS_FIGURE_12}); the paper has 14 N",
        ),
        (
            "Fig. 17: contact force over the damping ratio",
            "Section IV: little effect",
            "abstract: rises with less damping; conclusion: rises with more damping",
            _trend(result, damping, "contact_force_mean"),
        ),
        (
            "Fig. 17: kinetic energy over the damping ratio",
            "Section IV and conclusion: rises with more damping",
            "abstract: rises with less damping",
            _trend(result, damping, "kinetic_energy_rate"),
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
            _trend(result, "weight_on_bit", "contact_force_mean"),
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
            _energies(result),
        ),
    ]


def _blow(tool: str) -> str:
    contact = single_contact(preset("drilling").replace(**TOOLS[tool].changes), CONTACT_SPEED)
    return f"{show(contact.peak_force, 'N')} and {show(contact.peak_displacement, 'm')}"


def _rate(tool: str) -> float:
    return effective_tool(preset("drilling").replace(**TOOLS[tool].changes)).spring_rate


def _masses() -> str:
    masses = {
        name: 1e3 * effective_tool(preset("drilling").replace(contact_model=name)).mass
        for name in ("printed", "rayleigh", "mode_shape")
    }
    return (
        f"(22) as printed {masses['printed']:.3f} g, with the shape (24) "
        f"{masses['mode_shape']:.3f} g, with the opposite one {masses['rayleigh']:.3f} g; "
        "Fig. 12 implies "
        f"{1e3 * figure_12_implies()['tool_mass']:.2f} g"
    )


def _section_mass() -> float:
    drill = preset("drilling")
    volume = (
        drill.section_1_area * drill.section_1_length
        + drill.section_2_area * drill.section_2_length
    )
    return 1e3 * drill.drill_tool_density * volume


def _amplitude(result: Reproduction) -> str:
    fits = [fit for fit in result.fits if fit.reading.consistent]
    best = min(fits, key=lambda fit: fit.order)
    printed = result.fit(AS_FIGURE_12_PRINTED_AMPLITUDE)
    return (
        f"numbers within 10 %: {best.near()} of 10 with one A, e_1 and g for both; "
        f"{printed.near()} of 10 with 35 µm in both and e_1 = 0.4 in the rock; "
        f"{result.best.near()} of 10 with two amplitudes"
    )


def _before(result: Reproduction) -> str:
    parts = []
    for name in (PRESETS, AS_FIGURE_12):
        fit = result.fit(name)
        mass = 1e3 * fit.reading.before.drill_tool_mass
        rate = 0.6 * fit.values["free_impact_rate"].mean
        force = fit.values["free_reacting_force_mean"].mean
        parts.append(f"{mass:g} g ({name}): {rate:.0f} impacts in 0.6 s, {force:.1f} N")
    return f"{'; '.join(parts)}; paper: 260 and 5.8 N"


def _reacting(result: Reproduction, name: str) -> str:
    return show(result.fit(name).values["drilling_reacting_force_mean"].mean, "N")


def _trend(result: Reproduction, parameter: str, output: str) -> str:
    parts = []
    for drill in (PRESETS, BEST):
        trend = next(
            item
            for item in result.trends[drill]
            if (item.parameter, item.output) == (parameter, output)
        )
        parts.append(f"{trend.verdict} ({100.0 * trend.change:+.1f} %, {drill})")
    return "; ".join(parts)


def _energies(result: Reproduction) -> str:
    parts = []
    for fit in (result.fit(AS_FIGURE_12), result.fit(REASONED)):
        energies = fit.energies()
        meanings = ", ".join(f"{name} {show(energies[name], 'J')}" for name in ENERGIES)
        parts.append(f"{fit.reading.name}: {meanings}")
    return "; ".join(parts)
