"""Drill of the engine: constants derived from the parameters, and the moving state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpud_sim.model.closed_form import damping_coefficient
from rpud_sim.model.compile import record_type
from rpud_sim.model.contact import effective_tool
from rpud_sim.model.elementary import power
from rpud_sim.model.parameters import Parameters

# Damping ratio of a tool that rock or cuttings hold: while it is seated (``seating``) and with a
# jammed free mass. Assumed: the tables' value for the drill tool before drilling.
ROCK_DAMPING_RATIO = 0.5


class Drill(NamedTuple):
    """Constants of the drill in SI units.

    The tool is m_dt on the restoring spring before drilling (eq. (14)), and m_eff,dt on its own
    elasticity in the rock (eq. (29)). A jammed free mass is wedged to it by cuttings: from its next
    contact on, both are one body that only the actuator strikes.
    """

    rpud_mass: float
    rpud_weight: float  # [N]; zero unless gravity acts on the RPUD as well
    rpud_damping: float
    load_spring_rate: float
    free_mass: float
    tool_mass: float
    tool_damping: float
    tool_spring_rate: float
    tool_elasticity: float  # k_eff,dt [N/m], in both regimes
    actuator_restitution: float
    drill_tool_restitution: float
    gravity: float
    in_rock: bool
    jammed: bool


def derive(parameters: Parameters, jammed: bool = False) -> Drill:
    """Return the constants that the engine needs; a jam in the rock damps the tool."""
    effective = effective_tool(parameters)
    in_rock = parameters.regime == "drilling"
    if in_rock:
        tool_mass, tool_spring_rate = effective.mass, effective.spring_rate
        damping_ratio = ROCK_DAMPING_RATIO if jammed else 0.0
    else:
        tool_mass = parameters.drill_tool_mass
        tool_spring_rate = parameters.restoring_spring_rate
        damping_ratio = parameters.drill_tool_damping_ratio
    return Drill(
        rpud_mass=parameters.rpud_mass,
        rpud_weight=(
            parameters.rpud_mass * parameters.gravity if parameters.gravity_on_drill else 0.0
        ),
        rpud_damping=damping_coefficient(
            parameters.rpud_damping_ratio, parameters.rpud_mass, parameters.load_spring_rate
        ),
        load_spring_rate=parameters.load_spring_rate,
        free_mass=parameters.free_mass,
        tool_mass=tool_mass,
        tool_damping=damping_coefficient(damping_ratio, tool_mass, tool_spring_rate),
        tool_spring_rate=tool_spring_rate,
        tool_elasticity=effective.spring_rate,
        actuator_restitution=parameters.actuator_restitution,
        drill_tool_restitution=parameters.drill_tool_restitution,
        gravity=parameters.gravity,
        in_rock=in_rock,
        jammed=jammed,
    )


# Everything that moves, at the start of the open segment. Positions in m, velocities in m/s,
# positive toward the rock; the time is whole seconds and a fraction.
STATE = record_type(
    [
        ("seconds", np.int64),
        ("fraction", np.float64),
        ("phase", np.float64),
        ("frequency", np.float64),
        ("amplitude", np.float64),
        ("target_amplitude", np.float64),  # taken at the next zero of the vibration
        ("weight_on_bit", np.float64),
        ("contact", np.uint8),
        ("event", np.uint8),
        ("tool_at_rest", np.uint8),  # in the rock, between two contacts
        ("u_np", np.float64),
        ("v_np", np.float64),
        ("u_fm", np.float64),
        ("v_fm", np.float64),
        ("u_dt", np.float64),
        ("v_dt", np.float64),
        ("next_event", np.uint8),  # what ends the open segment, an END_* of search.py
        ("impacts", np.uint64),  # on the drill tool, so far
        ("impact_open", np.uint8),  # whether the last of them is still in contact
        ("standstill", np.int64),  # events in a row without time passing
        ("effort", np.float64),  # on the event budget, see tolerances.py
        # Of a resonant vibration, see resonator.py; all else is zero if it is prescribed.
        ("resonant", np.uint8),
        ("steady", np.uint8),  # no update until a contact or a command
        ("decay_time", np.float64),
        ("resistance", np.float64),
        ("amplitude_per_volt", np.float64),
        ("voltage", np.float64),
        ("drive_frequency", np.float64),
        ("drive_phase", np.float64),
        ("resonance_frequency", np.float64),
        ("envelope_real", np.float64),
        ("envelope_imag", np.float64),
        ("envelope_age", np.float64),  # time since the envelope was written
        ("update_due", np.float64),  # time until the next update is due
        ("drawn", np.float64),
        ("heat", np.float64),
        ("work", np.float64),
        ("owed", np.float64),
    ]
)


# Assumed, as the paper has no such transition: many periods of tool and drill, so that both follow,
# and a small part of the time for which a user drills.
SEATING_TIME = 0.1  # [s]
SEATING_STEPS = 20


def seating(before: Drill, after: Drill) -> list[tuple[float, Drill]]:
    """Return the constants of each step, with the time of the step after the change [s].

    A free drill tool gets into the rock in steps that are as before drilling: eqs. (11)-(14). Every
    other change is one step.
    """
    if before.in_rock or not after.in_rock:
        return [(0.0, after)]
    steps = []
    for step in range(1, SEATING_STEPS):
        share = step / SEATING_STEPS
        spring_rate = power(before.tool_spring_rate, 1.0 - share) * power(
            after.tool_spring_rate, share
        )
        drill = after._replace(
            in_rock=False,
            tool_mass=before.tool_mass,
            tool_spring_rate=spring_rate,
            tool_damping=damping_coefficient(ROCK_DAMPING_RATIO, before.tool_mass, spring_rate),
        )
        steps.append((SEATING_TIME * (share - 1.0 / SEATING_STEPS), drill))
    return [*steps, (SEATING_TIME, after)]
