"""Choices in what the paper leaves open, before drilling and in the rock.

A choice may differ before drilling and in the rock; a ``Reading`` holds both. What an impact is
said to transfer, and which collisions count, affect no run: they are chosen afterwards.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from rpud_sim.model.drill import effective_tool
from rpud_sim.simulation import Parameters, preset

STEEL, PRINTED_MODULUS = 1.96e11, 1.96e9  # E_dt of steel, and as Table 2 prints it [Pa]
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


TOOLS: Mapping[str, Tool] = MappingProxyType(
    {
        "printed": Tool("(22) and (27) as printed, steel", {"contact_model": "printed"}),
        "printed, E printed": Tool(
            "(22) and (27) as printed, E_dt as printed",
            {"contact_model": "printed", "elastic_modulus": PRINTED_MODULUS},
        ),
        "rayleigh": Tool(
            "mass and rate of two springs in series, steel", {"contact_model": "rayleigh"}
        ),
        "rayleigh, E printed": Tool(
            "mass and rate of two springs in series, E_dt as printed",
            {"contact_model": "rayleigh", "elastic_modulus": PRINTED_MODULUS},
        ),
        "mode_shape": Tool(
            "mass and rate of the shape (24), steel", {"contact_model": "mode_shape"}
        ),
        "mode_shape, E printed": Tool(
            "mass and rate of the shape (24), E_dt as printed",
            {"contact_model": "mode_shape", "elastic_modulus": PRINTED_MODULUS},
        ),
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

COUNTS = ("one", "both")  # impacts on the drill tool, or these and those of the actuator
ENERGIES: Mapping[str, str] = MappingProxyType(
    {
        "arriving": "kinetic energy of the free mass before each impact, the sum of m v^2 / 2",
        "common": "kinetic energy of free mass and tool after (21)",
        "net": "energy that arrives, less what the free mass takes back",
        "tool": "kinetic energy of the tool alone after (21)",
    }
)


def energy_share(energy: str, free_mass: float, tool_mass: float) -> float:
    """Return which share of the arriving energy counts as transferred to the drill tool.

    A free mass m strikes a resting tool M. After (21) both move at v m / (m + M), and the free mass
    leaves with that velocity when the contact ends.

    Args:
        energy: one of ``ENERGIES``.
        free_mass: m_fm [kg].
        tool_mass: m_eff,dt [kg].
    """
    ratio = free_mass / (free_mass + tool_mass)
    return {
        "arriving": 1.0,
        "common": ratio,
        "net": 1.0 - ratio**2,
        "tool": ratio * (1.0 - ratio),
    }[energy]


@dataclasses.dataclass(frozen=True)
class Before:
    """Choices before drilling; there is no weight on bit."""

    vibration_amplitude: float = PRINTED_AMPLITUDE  # [m]
    actuator_restitution: float = 1.0  # e_1
    gravity: float = 9.81  # [m/s^2]
    drill_tool_mass: float = PRINTED_TOOL_MASS  # [kg]
    count: str = "one"  # one of ``COUNTS``

    def parameters(self) -> Parameters:
        """Return the drill before drilling."""
        return _drill_before(self)

    def __str__(self) -> str:
        return (
            f"A = {1e6 * self.vibration_amplitude:g} µm, e_1 = {self.actuator_restitution:g}, "
            f"g = {self.gravity:g} m/s², m_dt = {1e3 * self.drill_tool_mass:g} g{_counted(self)}"
        )


@dataclasses.dataclass(frozen=True)
class Rock:
    """Choices in the rock."""

    vibration_amplitude: float = PRINTED_AMPLITUDE  # [m]
    actuator_restitution: float = 1.0  # e_1
    weight_on_bit: float = 10.0  # [N]
    gravity: float = 9.81  # [m/s^2]
    tool: str = "printed"  # one of ``TOOLS``
    energy: str = "arriving"  # one of ``ENERGIES``
    count: str = "one"  # one of ``COUNTS``

    def parameters(self) -> Parameters:
        """Return the drill in the rock."""
        return _drill_in_rock(self)

    def energy_share(self) -> float:
        """Return the share of the arriving energy that counts as transferred."""
        drill = self.parameters()
        return energy_share(self.energy, drill.free_mass, effective_tool(drill).mass)

    def __str__(self) -> str:
        return (
            f"A = {1e6 * self.vibration_amplitude:g} µm, e_1 = {self.actuator_restitution:g}, "
            f"W = {self.weight_on_bit:g} N, g = {self.gravity:g} m/s², tool: {self.tool}, "
            f"energy: {self.energy}{_counted(self)}"
        )


# A search asks for the same drill many times, and each new one checks every parameter.
@cache
def _drill_before(choices: Before) -> Parameters:
    return preset("free").replace(
        vibration_amplitude=choices.vibration_amplitude,
        actuator_restitution=choices.actuator_restitution,
        gravity=choices.gravity,
        drill_tool_mass=choices.drill_tool_mass,
    )


@cache
def _drill_in_rock(choices: Rock) -> Parameters:
    return preset("drilling").replace(
        vibration_amplitude=choices.vibration_amplitude,
        actuator_restitution=choices.actuator_restitution,
        weight_on_bit=choices.weight_on_bit,
        gravity=choices.gravity,
        **TOOLS[choices.tool].changes,
    )


def _counted(choices: Before | Rock) -> str:
    return "" if choices.count == "one" else ", both collisions counted"


@dataclasses.dataclass(frozen=True)
class Reading:
    """Set of choices with a name."""

    name: str  # of the reading
    before: Before  # choices before drilling
    rock: Rock  # choices in the rock
    reasons: tuple[str, ...] = ()  # for its choices; none for a reading that a search found

    @property
    def searched(self) -> bool:
        """Whether a search found it, by the very numbers that it is compared with."""
        return not self.reasons

    @property
    def consistent(self) -> bool:
        """Whether A, e_1 and g are the same before drilling and in the rock."""
        return all(
            getattr(self.before, name) == getattr(self.rock, name)
            for name in ("vibration_amplitude", "actuator_restitution", "gravity")
        )

    def parameters(self, regime: str) -> Parameters:
        """Return the drill of a regime."""
        return self.before.parameters() if regime == "free" else self.rock.parameters()

    def __str__(self) -> str:
        return f"{self.name} (before drilling: {self.before}; in the rock: {self.rock})"
