"""Runs over the paper's windows: from rest, for 0.6 s and 5 s, one for each initial phase.

Members are independent. Their spread is the chance in one run of the paper, and their standard
error is that of the mean.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.segment import EVENT_ACTUATOR_IMPACT
from rpud_sim.simulation import EngineError, Parameters
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

SHORT = 0.6  # Figs. 3, 8, 10, 11 and 13 [s]
LONG = 5.0  # Fig. 5, and by assumption Fig. 14 [s]
MOST_FORCES = (0.05, 0.95)  # quantiles that bound "most of the contact forces"
FORCE_RANGE = (400.0, 2200.0)  # Fig. 11 [N]

_SAMPLE_RATE = 5000  # for the greatest displacements; these motions are slower than 100 Hz [Hz]


@dataclasses.dataclass(frozen=True)
class Members:
    """Figures of the members of an ensemble."""

    values: dict[str, np.ndarray]  # by name, each of shape (n,); NaN if a member has no such figure
    stalled: int  # number of members that the engine could not finish; ``values`` lacks them


def run_windows(parameters: Parameters, phases: np.ndarray, long: float = LONG) -> Members:
    """Run the paper's windows once per initial phase.

    Args:
        phases: initial phase of each member, shape (n,) [cycles].
        long: window of the mean reacting force [s]; a search takes a shorter one than the paper.
    """
    members = []
    stalled = 0
    for phase in phases:
        try:
            members.append(_run_window(parameters, float(phase), long))
        except EngineError:
            stalled += 1
    names = members[0] if members else {}
    return Members({name: np.array([m[name] for m in members]) for name in names}, stalled)


def _run_window(parameters: Parameters, phase: float, long: float) -> dict[str, float]:
    simulation = Simulation(parameters, phase)
    statistics = Statistics()
    block = simulation.advance_to(round(SHORT * SECOND))
    figures = _short_figures(block)
    statistics.add(block)
    statistics.add(simulation.advance_to(round(long * SECOND)))
    figures["reacting_force_mean"] = float(statistics.figures()["reacting_force_mean"] or 0.0)
    return figures


def _short_figures(block: Block) -> dict[str, float]:
    forces = block.impacts["peak_force"]
    struck = np.count_nonzero(block.segments["event"] & EVENT_ACTUATOR_IMPACT)
    inside = (forces >= FORCE_RANGE[0]) & (forces <= FORCE_RANGE[1])
    samples = block.sample(Times.from_grid(0, round(SHORT * _SAMPLE_RATE), _SAMPLE_RATE))
    low, high = np.quantile(forces, MOST_FORCES) if len(forces) else (np.nan, np.nan)
    return {
        "drill_tool_impact_rate": len(block.impacts) / SHORT,
        "actuator_impact_rate": struck / SHORT,
        "contact_force_max": float(forces.max()) if len(forces) else np.nan,
        "contact_force_low": float(low),
        "contact_force_high": float(high),
        "contact_force_share": float(inside.mean()) if len(forces) else np.nan,
        # What arrives, the sum of m v^2 / 2; what stays is a share of it: choices.energy_share.
        "kinetic_energy": float(block.impacts["energy"].sum()),
        "nodal_plane_displacement": float(np.abs(samples.nodal_plane_position).max()),
        "nodal_plane_mean": float(np.abs(samples.nodal_plane_position.mean())),
        "drill_tool_displacement": float(np.abs(samples.drill_tool_displacement).max()),
    }
