"""Choices in what the paper leaves open, before drilling and in the rock, with their reasons.

A choice may differ before drilling and in the rock. The meaning of "transferred energy" affects no
run: it is chosen afterwards.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from rpud_sim.model.contact import effective_tool
from rpud_sim.simulation import Parameters, preset
from validation.numbers import CONTACT_SPEED, FIGURE_12

SHAPE_MASS = 2.124e-3  # m_eff,dt of the mode shape of eq. (24) with Table 2 [kg]
SHAPE_ON_SERIES, IMPLIED = "shape mass, series", "as Fig. 12 implies"

_MODELS = {
    "printed": "(22) and (27) as printed",
    "rayleigh": "mass and rate of two springs in series",
    "mode_shape": "mass and rate of the shape (24)",
}


def _given(mass: float, spring_rate: float) -> dict[str, Any]:
    tool = {"effective_tool_mass": mass, "effective_tool_spring_rate": spring_rate}
    return {"contact_model": "given", **tool}


# Drill tools in the rock: what each means, and the parameters that set it. Table 2 prints E_dt as
# 1.96e9 Pa. Two springs in series with Table 2 and steel have 4.748e7 N/m.
TOOLS: dict[str, tuple[str, dict[str, Any]]] = {
    **{
        f"{model}{name}": (f"{meaning}, {modulus}", {"contact_model": model, **changes})
        for model, meaning in _MODELS.items()
        for name, modulus, changes in (
            ("", "steel", {}),
            (", E printed", "E_dt as printed", {"elastic_modulus": 1.96e9}),
        )
    },
    SHAPE_ON_SERIES: (
        "mass of the shape (24) on two springs in series, steel",
        _given(SHAPE_MASS, 4.748e7),
    ),
    # See ``figure_12_implies``.
    IMPLIED: ("mass and rate that give both numbers of Fig. 12", _given(1.72e-3, 5.28e7)),
}


def with_tool(name: str) -> Parameters:
    """Return the preset in the rock with one of ``TOOLS``."""
    return preset("drilling").replace(**TOOLS[name][1])


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
    """Choices before drilling; there is no weight on bit. A_0 and m_dt are from Table 1."""

    vibration_amplitude: float = 35e-6  # [m]
    actuator_restitution: float = 1.0  # e_1
    gravity: float = 0.0  # [m/s^2]
    drill_tool_mass: float = 13.5e-3  # [kg]

    def __str__(self) -> str:
        return (
            f"A = {1e6 * self.vibration_amplitude:g} µm, e_1 = {self.actuator_restitution:g}, "
            f"g = {self.gravity:g} m/s², m_dt = {1e3 * self.drill_tool_mass:g} g"
        )


@dataclasses.dataclass(frozen=True)
class Rock:
    """Choices in the rock."""

    vibration_amplitude: float = 35e-6  # [m]
    actuator_restitution: float = 1.0  # e_1
    weight_on_bit: float = 10.0  # [N]
    gravity: float = 9.81  # [m/s^2]
    tool: str = "printed"  # one of ``TOOLS``
    energy: str = "arriving"  # one of ``energy_shares``

    def parameters(self) -> Parameters:
        """Return the drill in the rock."""
        own = dataclasses.asdict(self)
        tool, _ = own.pop("tool"), own.pop("energy")
        return with_tool(tool).replace(**own)

    def energy_shares(self) -> dict[str, float]:
        """Return the share of the arriving energy by each meaning of “transferred”.

        A free mass m strikes a resting tool M. After (21) both move at v m / (m + M), and the free
        mass leaves with that velocity when the contact ends. ``common`` is the energy of both,
        ``tool`` the tool's energy, ``net`` what arrives less what the free mass takes back.
        """
        drill = self.parameters()
        ratio = drill.free_mass / (drill.free_mass + effective_tool(drill).mass)
        shares = {"arriving": 1.0, "common": ratio, "net": 1.0 - ratio**2}
        return {**shares, "tool": ratio * (1.0 - ratio)}

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
    reasons: str  # for the choices

    def parameters(self, regime: str) -> Parameters:
        """Return the drill of a regime."""
        if regime == "free":
            return preset("free").replace(**dataclasses.asdict(self.before))
        return self.rock.parameters()


TABLES = "tables with steel"
REASONED = "springs in series"
AS_FIGURE_12 = "Fig. 12's tool"
AS_FIGURE_12_PRINTED_AMPLITUDE = "Fig. 12's tool, A as printed"
FITTED = "Fig. 12's tool, fitted"
ONE_AMPLITUDE = "one A and e_1, Fig. 12's tool"

_HALF_AMPLITUDE = 17.5e-6  # 35 um read as peak to peak [m]
_BEFORE = Before(drill_tool_mass=SHAPE_MASS)

_BEFORE_REASONS = (
    "Table 1 as printed: A = 35 µm, both restitutions are one, and neither gravity nor weight on "
    "bit, because the table has none. m_dt is 2.124 g instead of 13.5 g: the mass that the shape "
    "(24) gives the tool. That the paper's program used it in both sections is a guess. "
)
_HALF = "A = 17.5 µm, if 35 µm is peak to peak. Before drilling 35 µm fits, not half of it. "
_SEARCHED = (
    "A, e_1 and g are the same before drilling and in the rock. A, e_1 and W are fitted: the best "
    "that a search found from 10 to 40 µm, 0.4 to 1 and 0 to 16 N."
)

NAMED = (
    Choices(TABLES, Before(gravity=9.81), Rock(),
        "config/tables_free.yaml and config/tables_drilling.yaml. Tables 1 and 2 with steel's "
        "modulus, earth's gravity, and 10 N as weight on bit, of which Table 2 has none; (22) and "
        "(27) as printed."),
    Choices("tables as printed", Before(),
        Rock(weight_on_bit=0.0, gravity=0.0, tool="printed, E printed"),
        "Tables 1 and 2 to the letter: E_dt = 1.96e9 Pa, no gravity and no weight on bit, because "
        "the tables have none."),
    Choices(REASONED, _BEFORE,
        Rock(_HALF_AMPLITUDE, 1.0, 9.81, tool=SHAPE_ON_SERIES, energy="common"),
        f"{_BEFORE_REASONS}No number is fitted. The tool has the mass of the shape (24) on two "
        f"springs in series with steel. {_HALF}W is the weight of the 1 kg RPUD that hangs on the "
        "tool. The energy is of the common motion after (21)."),
    Choices(AS_FIGURE_12, _BEFORE, Rock(_HALF_AMPLITUDE, 0.9, 8.0, tool=IMPLIED),
        f"{_BEFORE_REASONS}Mass and spring rate give both numbers of Fig. 12 by (21), (30) and "
        f"(36). {_HALF}W = 8 N and e_1 = 0.9 are fitted. Table 2 prints e_1 = 1 and no W."),
    Choices(AS_FIGURE_12_PRINTED_AMPLITUDE, _BEFORE,
        Rock(actuator_restitution=0.4, weight_on_bit=6.0, tool=IMPLIED),
        f"{_BEFORE_REASONS}The tool of Fig. 12, and A = 35 µm as printed. W = 6 N and e_1 = 0.4 "
        "are fitted. A lower e_1 does much the same as a lower A, so these numbers hardly "
        "distinguish them."),
    Choices(FITTED, _BEFORE, Rock(20e-6, 0.8, 8.0, tool=IMPLIED),
        f"{_BEFORE_REASONS}The default of each regime, config/free.yaml and config/drilling.yaml. "
        "The tool of Fig. 12. A = 20 µm, W = 8 N and e_1 = 0.8 are fitted round numbers; nothing "
        "in the paper names them."),
    Choices(ONE_AMPLITUDE, Before(30.6e-6, 0.43, 9.81), Rock(30.6e-6, 0.43, 5.7, tool=IMPLIED),
        _SEARCHED),
    Choices("one A and e_1, springs in series", Before(33e-6, 0.67, 0.0, SHAPE_MASS),
        Rock(33e-6, 0.67, 5.7, 0.0, tool=SHAPE_ON_SERIES, energy="common"), _SEARCHED),
)  # fmt: skip


def named(name: str) -> Choices:
    """Return named choices."""
    return next(choices for choices in NAMED if choices.name == name)
