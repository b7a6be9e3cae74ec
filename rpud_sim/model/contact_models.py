"""Contact models: the drill tool in the rock as one mass on one spring, eqs. (22), (24)-(27)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple


class EffectiveTool(NamedTuple):
    """The drill tool as one mass on one spring."""

    mass: float  # m_eff,dt [kg]
    spring_rate: float  # k_eff,dt [N/m]


def printed_tool(k_1: float, k_2: float, m_1: float, m_2: float) -> EffectiveTool:
    """The drill tool with eqs. (22) and (27) as printed, whose terms belong to two mode shapes."""
    both = k_1 + k_2
    mass = (k_1 * k_1 + 3.0 * k_1 * k_2 + 3.0 * k_2 * k_2) * m_1 + k_1 * k_1 * m_2
    return EffectiveTool(mass / (3.0 * both * both), (k_1 * k_1 - k_1 * k_2 + k_2 * k_2) / both)


def rayleigh_tool(k_1: float, k_2: float, m_1: float, m_2: float) -> EffectiveTool:
    """The drill tool by Rayleigh's method: two springs in series, f(L_dt1) = k_1 / (k_1 + k_2)."""
    return EffectiveTool(_mass_of_shape(k_1 / (k_1 + k_2), m_1, m_2), k_1 * k_2 / (k_1 + k_2))


def mode_shape_tool(k_1: float, k_2: float, m_1: float, m_2: float) -> EffectiveTool:
    """The drill tool with the mode shape of eq. (24), f(L_dt1) = k_2 / (k_1 + k_2), throughout.

    Eq. (26) then gives the spring rate of eq. (27), and (25) the mass of (22) with one index
    changed.
    """
    mass = _mass_of_shape(k_2 / (k_1 + k_2), m_1, m_2)
    return EffectiveTool(mass, printed_tool(k_1, k_2, m_1, m_2).spring_rate)


def _mass_of_shape(shape: float, m_1: float, m_2: float) -> float:
    """m_eff,dt [kg] of a mode shape with f(L_dt1) = shape, eq. (25)."""
    return ((1.0 + shape + shape * shape) * m_1 + shape * shape * m_2) / 3.0


# Laws of the contact in the rock, by their name: what they are, and functions of spring rate [N/m]
# and mass [kg] of parts I and II. ``given`` takes the tool from the parameters.
LAWS: Mapping[str, tuple[str, Callable[[float, float, float, float], EffectiveTool]]] = {
    "printed": ("(22) and (27) as printed", printed_tool),
    "rayleigh": ("two springs in series", rayleigh_tool),
    "mode_shape": ("the shape of (24) in both", mode_shape_tool),
}
CONTACT_MODELS = (*LAWS, "given")
CONTACT_MODELS_TEXT = ", ".join(said for said, _ in LAWS.values()) + ", or given"
