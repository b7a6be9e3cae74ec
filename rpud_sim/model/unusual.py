"""Values of a drill that are far from the default: the likely causes when the engine fails."""

from __future__ import annotations

import numpy as np

from rpud_sim.model.drill import Drill
from rpud_sim.model.parameters import QUANTITIES, Parameters

# How many values a message names, and how far from the default a value is unusual [factor].
_MOST = 4
_USUAL = 30.0

_ALWAYS = (
    "rpud_mass",
    "free_mass",
    "load_spring_rate",
    "gravity",
    "weight_on_bit",
    "vibration_amplitude",
    "vibration_frequency",
)
_BEFORE_DRILLING = ("drill_tool_mass", "restoring_spring_rate")
_GIVEN = ("effective_tool_mass", "effective_tool_spring_rate")
_SECTIONS = (
    "elastic_modulus",
    "section_1_length",
    "section_1_area",
    "section_2_length",
    "section_2_area",
    "drill_tool_density",
)


def unusual_values(parameters: Parameters, drill: Drill, state: np.void) -> list[str]:
    """Return the values in force that are furthest from the default, furthest first.

    Returns:
        At least one text such as ``free_mass = 1e-09 kg (default: 0.005)``.
    """
    usual = Parameters()
    ranked = sorted(
        (
            (
                max(value / getattr(usual, name), getattr(usual, name) / value),
                f"{name} = {value:.4g} {QUANTITIES[name].unit} (default: {getattr(usual, name):g})",
            )
            for name, value in _acting(parameters, drill, state).items()
            if value > 0.0  # zero is usual: a drill without gravity, weight or drive
        ),
        reverse=True,
    )
    far = [text for factor, text in ranked if factor > _USUAL]
    return (far or [text for _, text in ranked[:1]])[:_MOST]


def _acting(parameters: Parameters, drill: Drill, state: np.void) -> dict[str, float]:
    """Return the values that act on the motion: those that may change from where they are."""
    tool: tuple[str, ...] = _BEFORE_DRILLING
    if drill.in_rock:
        tool = _GIVEN if parameters.contact_model == "given" else _SECTIONS
    values = {name: float(getattr(parameters, name)) for name in (*_ALWAYS, *tool)}
    values["load_spring_rate"] = drill.load_spring_rate
    values["gravity"] = drill.gravity
    values["weight_on_bit"] = float(state["weight_on_bit"])
    values["vibration_amplitude"] = float(state["amplitude"])
    values["vibration_frequency"] = float(state["frequency"])
    if not drill.in_rock:
        values["restoring_spring_rate"] = drill.tool_spring_rate
    return values
