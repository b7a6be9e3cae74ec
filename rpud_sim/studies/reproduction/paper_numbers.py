"""Numbers that the paper states, and which figure of which run is the model's counterpart."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Number:
    """Number of the paper."""

    key: str  # its name in the JSON
    paper: float  # its value, in SI units
    unit: str  # SI unit
    source: str  # figure of the paper
    statement: str  # meaning, in the paper's words where they matter
    regime: str  # of the model's run; ``contact`` is the single collision at 5 m/s
    figure: str  # name of the figure of that run
    measured: bool = False  # whether the paper measured it, rather than simulated it
    label: str = ""  # short heading of its column


CONTACT_SPEED = 5.0  # Fig. 12 [m/s]

# Regime, figure, value, unit, source, statement.
_SIMULATED = (
    ("free", "impact_rate", 260 / 0.6, "1/s", "Fig. 3", "260 impacts in 0.6 s, “nearly 430 Hz”"),
    ("free", "reacting_force_mean", 5.8, "N", "Fig. 5", "mean reacting force of the first 5 s"),
    ("drilling", "impact_rate", 282 / 0.6, "1/s", "Fig. 8",
     "282 impacts in 0.6 s, “nearly 470 Hz”"),
    ("drilling", "contact_force_max", 2600.0, "N", "Fig. 10", "greatest contact force in 0.6 s"),
    ("drilling", "contact_force_low", 400.0, "N", "Fig. 11",
     "“most” contact forces are above (5 % quantile)"),
    ("drilling", "contact_force_high", 2200.0, "N", "Fig. 11",
     "“most” contact forces are below (95 % quantile)"),
    ("drilling", "kinetic_energy", 12.4, "J", "Fig. 13",
     "kinetic energy brought to the drill tool in 0.6 s"),
    ("drilling", "reacting_force_mean", 14.0, "N", "Fig. 14",
     "mean reacting force (taken over 5 s)"),
    ("contact", "peak_force", 1650.0, "N", "Fig. 12", "contact force of one collision at 5 m/s"),
    ("contact", "peak_displacement", 42e-6, "m", "Fig. 12",
     "displacement of one collision at 5 m/s"),
)  # fmt: skip
_MEASURED = (
    ("free", "nodal_plane_displacement", 2.6e-3, "m", "Fig. 20",
     "measured displacement amplitude of the nodal plane (greatest in 0.6 s)"),
    ("free", "drill_tool_displacement", 14e-3, "m", "Fig. 20",
     "measured displacement amplitude of the drill tool (greatest in 0.6 s)"),
    ("free", "reacting_force_mean", 5.2, "N", "Fig. 21", "measured mean reacting force"),
)  # fmt: skip

_LABELS = {
    "contact_force_low": "low",
    "contact_force_high": "high",
    "peak_force": "force",
    "peak_displacement": "displacement",
    "nodal_plane_displacement": "nodal plane",
    "drill_tool_displacement": "drill tool",
}


def _label(source: str, figure: str) -> str:
    return f"{source} {_LABELS[figure]}" if figure in _LABELS else source


SIMULATED = tuple(
    Number(
        f"{regime}_{figure}", paper, unit, source, statement, regime, figure, False,
        _label(source, figure),
    )
    for regime, figure, paper, unit, source, statement in _SIMULATED
)  # fmt: skip
MEASURED = tuple(
    Number(
        f"measured_{figure}", paper, unit, source, statement, regime, figure, True,
        _label(source, figure),
    )
    for regime, figure, paper, unit, source, statement in _MEASURED
)  # fmt: skip
NUMBERS = (*SIMULATED, *MEASURED)

KINETIC_ENERGY = "drilling_kinetic_energy"  # key of Fig. 13
_DYNAMICS = ("Fig. 8", "Fig. 13", "Fig. 14")

# The simulated numbers, by what of the drill they depend on.
GROUPS = {
    "before drilling": tuple(number for number in SIMULATED if number.regime == "free"),
    "drilling dynamics": tuple(number for number in SIMULATED if number.source in _DYNAMICS),
    "contact": tuple(
        number for number in SIMULATED if number.regime != "free" and number.source not in _DYNAMICS
    ),
}
