"""Numbers that the paper states, and the figure of a run of the model to compare with each."""

from __future__ import annotations

import dataclasses

from rpud_sim.studies.fit.measures import Measure

CONTACT_SPEED = 5.0  # Fig. 12 [m/s]

_SHORT = 0.6  # window of Figs. 3, 8, 10, 11 and 13 [s]
_LONG = 5.0  # window of Fig. 5, and by assumption of Fig. 14 [s]


@dataclasses.dataclass(frozen=True)
class Number:
    """Number of the paper."""

    label: str  # figure of the paper, and which of its numbers
    regime: str  # of the model's run
    measure: Measure  # of that run
    paper: float  # its value, in SI units
    statement: str  # meaning, in the paper's words where they matter

    @property
    def unit(self) -> str:
        """SI unit."""
        return self.measure.unit


def _number(
    label: str, regime: str, figure: str, window: float, paper: float, statement: str
) -> Number:
    return Number(label, regime, Measure(figure, 0.0, window), paper, statement)


def _force(label: str, share: float, paper: float, statement: str) -> Number:
    measure = Measure("peak_force", 0.0, _SHORT, share)
    return Number(label, "drilling", measure, paper, statement)


KINETIC_ENERGY = _number(
    "Fig. 13", "drilling", "kinetic_energy", _SHORT, 12.4, "energy brought to the tool in 0.6 s"
)  # fmt: skip
FIGURE_12 = (
    _number("Fig. 12 force", "drilling", "contact_peak_force", 0.0, 1650.0,
            "contact force of one collision at 5 m/s"),
    _number("Fig. 12 displacement", "drilling", "contact_peak_displacement", 0.0, 42e-6,
            "displacement of one collision at 5 m/s"),
)  # fmt: skip
SIMULATED = (
    _number("Fig. 3", "free", "drill_tool_impact_rate", _SHORT, 260 / 0.6,
            "260 impacts in 0.6 s, “nearly 430 Hz”"),
    _number("Fig. 5", "free", "reacting_force_mean", _LONG, 5.8, "mean reacting force"),
    _number("Fig. 8", "drilling", "drill_tool_impact_rate", _SHORT, 282 / 0.6,
            "282 impacts in 0.6 s, “nearly 470 Hz”"),
    KINETIC_ENERGY,
    _number("Fig. 14", "drilling", "reacting_force_mean", _LONG, 14.0, "mean reacting force"),
    _number("Fig. 10", "drilling", "contact_force_max", _SHORT, 2600.0, "greatest contact force"),
    _force("Fig. 11 low", 0.05, 400.0, "“most” forces are above (5 % quantile)"),
    _force("Fig. 11 high", 0.95, 2200.0, "“most” forces are below (95 % quantile)"),
    *FIGURE_12,
)  # fmt: skip
MEASURED = (
    _number("Fig. 20 nodal plane", "free", "nodal_plane_displacement", _SHORT, 2.6e-3,
            "measured amplitude; greatest displacement in 0.6 s"),
    _number("Fig. 20 drill tool", "free", "drill_tool_displacement", _SHORT, 14e-3,
            "measured amplitude; greatest displacement in 0.6 s"),
    _number("Fig. 21", "free", "reacting_force_mean", _LONG, 5.2, "measured mean reacting force"),
)  # fmt: skip
NUMBERS = (*SIMULATED, *MEASURED)
