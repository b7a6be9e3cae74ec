"""Choices in what the paper leaves open, before drilling and in the rock.

A choice may differ before drilling and in the rock. What an impact is said to transfer affects no
run: it is chosen afterwards.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from rpud_sim.model.contact import effective_tool
from rpud_sim.simulation import Parameters, preset
from validation.paper_numbers import CONTACT_SPEED, FIGURE_12

PRINTED_MODULUS = 1.96e9  # E_dt as Table 2 prints it [Pa]
PRINTED_AMPLITUDE = 35e-6  # A_0 of Tables 1 and 2 [m]
PRINTED_TOOL_MASS = 13.5e-3  # m_dt of Table 1 [kg]
SHAPE_MASS = 2.124e-3  # m_eff,dt of the mode shape of eq. (24) with Table 2 [kg]
SERIES_SPRING_RATE = 4.748e7  # two springs in series with Table 2 and steel [N/m]
IMPLIED_MASS, IMPLIED_SPRING_RATE = 1.72e-3, 5.28e7  # see ``figure_12_implies`` [kg, N/m]

SHAPE_ON_SERIES = "shape mass, series"
IMPLIED = "as Fig. 12 implies"


@dataclasses.dataclass(frozen=True)
class Tool:
    """Drill tool in the rock: effective mass and spring rate, each a choice of its own."""

    meaning: str  # in words
    changes: Mapping[str, Any]  # parameters that set it


def _given(mass: float, spring_rate: float) -> dict[str, Any]:
    return {
        "contact_model": "given",
        "effective_tool_mass": mass,
        "effective_tool_spring_rate": spring_rate,
    }


def _modelled(contact_model: str, meaning: str) -> dict[str, Tool]:
    """Return the tool of a contact model with steel's modulus, and with the printed one."""
    changes = {"contact_model": contact_model}
    return {
        contact_model: Tool(f"{meaning}, steel", changes),
        f"{contact_model}, E printed": Tool(
            f"{meaning}, E_dt as printed", {**changes, "elastic_modulus": PRINTED_MODULUS}
        ),
    }


TOOLS: Mapping[str, Tool] = MappingProxyType(
    {
        **_modelled("printed", "(22) and (27) as printed"),
        **_modelled("rayleigh", "mass and rate of two springs in series"),
        **_modelled("mode_shape", "mass and rate of the shape (24)"),
        SHAPE_ON_SERIES: Tool(
            "mass of the shape (24) on two springs in series, steel",
            _given(SHAPE_MASS, SERIES_SPRING_RATE),
        ),
        IMPLIED: Tool(
            "mass and rate that give both numbers of Fig. 12",
            _given(IMPLIED_MASS, IMPLIED_SPRING_RATE),
        ),
    }
)


def with_tool(name: str) -> Parameters:
    """Return the preset in the rock with one of ``TOOLS``."""
    return preset("drilling").replace(**TOOLS[name].changes)


def energy_shares(free_mass: float, tool_mass: float) -> dict[str, float]:
    """Return the share of the arriving energy that counts as transferred, by its meaning.

    A free mass m strikes a resting tool M. After (21) both move at v m / (m + M), and the free mass
    leaves with that velocity when the contact ends. ``common`` is the energy of both, ``tool`` that
    of the tool, and ``net`` what arrives less what the free mass takes back.
    """
    ratio = free_mass / (free_mass + tool_mass)
    return {
        "arriving": 1.0,
        "common": ratio,
        "net": 1.0 - ratio**2,
        "tool": ratio * (1.0 - ratio),
    }


def figure_12_implies() -> tuple[float, float]:
    """Return effective mass [kg] and spring rate [N/m] of the tool that Fig. 12 implies.

    Such a tool gives both numbers of Fig. 12 by eqs. (21), (30) and (36), without gravity:
    F = m_fm w^2 eta and v' = w eta.
    """
    force, displacement = (number.paper for number in FIGURE_12)
    free_mass = preset("drilling").free_mass
    square = force / (free_mass * displacement)
    mass = free_mass * (CONTACT_SPEED / (square**0.5 * displacement) - 1.0)
    return mass, square * (free_mass + mass)


@dataclasses.dataclass(frozen=True)
class Before:
    """Choices before drilling; there is no weight on bit."""

    vibration_amplitude: float = PRINTED_AMPLITUDE  # [m]
    actuator_restitution: float = 1.0  # e_1
    gravity: float = 0.0  # [m/s^2]
    drill_tool_mass: float = PRINTED_TOOL_MASS  # [kg]

    def parameters(self) -> Parameters:
        """Return the drill before drilling."""
        return preset("free").replace(**dataclasses.asdict(self))

    def __str__(self) -> str:
        return (
            f"A = {1e6 * self.vibration_amplitude:g} µm, e_1 = {self.actuator_restitution:g}, "
            f"g = {self.gravity:g} m/s², m_dt = {1e3 * self.drill_tool_mass:g} g"
        )


@dataclasses.dataclass(frozen=True)
class Rock:
    """Choices in the rock."""

    vibration_amplitude: float = PRINTED_AMPLITUDE  # [m]
    actuator_restitution: float = 1.0  # e_1
    weight_on_bit: float = 10.0  # [N]
    gravity: float = 9.81  # [m/s^2]
    tool: str = "printed"  # one of ``TOOLS``
    energy: str = "arriving"  # one of ``energy_shares``

    def parameters(self) -> Parameters:
        """Return the drill in the rock."""
        return with_tool(self.tool).replace(
            vibration_amplitude=self.vibration_amplitude,
            actuator_restitution=self.actuator_restitution,
            weight_on_bit=self.weight_on_bit,
            gravity=self.gravity,
        )

    def energy_shares(self) -> dict[str, float]:
        """Return the share of the arriving energy by each meaning of “transferred”."""
        drill = self.parameters()
        return energy_shares(drill.free_mass, effective_tool(drill).mass)

    def __str__(self) -> str:
        return (
            f"A = {1e6 * self.vibration_amplitude:g} µm, e_1 = {self.actuator_restitution:g}, "
            f"W = {self.weight_on_bit:g} N, g = {self.gravity:g} m/s², tool: {self.tool}, "
            f"energy: {self.energy}"
        )


@dataclasses.dataclass(frozen=True)
class Choices:
    """Set of choices with a name."""

    name: str  # of the set
    before: Before  # before drilling
    rock: Rock  # in the rock
    reasons: tuple[str, ...]  # for the choices

    def parameters(self, regime: str) -> Parameters:
        """Return the drill of a regime."""
        return self.before.parameters() if regime == "free" else self.rock.parameters()
