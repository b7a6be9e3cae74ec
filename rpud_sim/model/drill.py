"""Drill of the engine: constants derived from the parameters, and the moving state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpud_sim.model.closed_form import damping_coefficient
from rpud_sim.model.compile import floats, record_type
from rpud_sim.model.contact import effective_tool
from rpud_sim.model.elementary import power
from rpud_sim.model.parameters import Parameters

# Damping ratio of a tool that rock or cuttings hold: while it is seated (``seating``) and with a
# jammed free mass. Assumed: the tables' value for the drill tool before drilling.
ROCK_DAMPING_RATIO = 0.5


class DrillConstants(NamedTuple):
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


def derive(parameters: Parameters, jammed: bool = False) -> DrillConstants:
    """Return the constants that the engine needs; a jam in the rock damps the tool."""
    effective = effective_tool(parameters)
    in_rock = parameters.regime == "drilling"
    if in_rock:
        tool_mass, tool_spring_rate = effective
        ratio = ROCK_DAMPING_RATIO if jammed else 0.0
    else:
        tool_mass, tool_spring_rate = parameters.drill_tool_mass, parameters.restoring_spring_rate
        ratio = parameters.drill_tool_damping_ratio
    mass, load_spring_rate = parameters.rpud_mass, parameters.load_spring_rate
    return DrillConstants(
        rpud_mass=mass,
        rpud_weight=mass * parameters.gravity if parameters.gravity_on_drill else 0.0,
        rpud_damping=damping_coefficient(parameters.rpud_damping_ratio, mass, load_spring_rate),
        load_spring_rate=load_spring_rate,
        free_mass=parameters.free_mass,
        tool_mass=tool_mass,
        tool_damping=damping_coefficient(ratio, tool_mass, tool_spring_rate),
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
        *floats("fraction", "phase", "frequency", "amplitude"),
        *floats("target_amplitude"),  # taken at the next zero of the vibration
        *floats("weight_on_bit"),
        ("contact", np.uint8),
        ("event", np.uint8),
        ("tool_at_rest", np.uint8),  # whether it rests in the rock, between two contacts
        *floats("u_np", "v_np", "u_fm", "v_fm", "u_dt", "v_dt"),
        ("next_event", np.uint8),  # what ends the open segment, an END_* of search.py
        ("impacts", np.uint64),  # number of impacts on the drill tool so far
        ("impact_open", np.uint8),  # whether the last of them is still in contact
        ("standstill", np.int64),  # consecutive events without time passing
        *floats("effort"),  # effort on the event budget, see tolerances.py
        # Of a resonant vibration, see resonator.py; all else is zero if it is prescribed.
        ("resonant", np.uint8),
        ("steady", np.uint8),  # no update until a contact or a command
        *floats("decay_time", "resistance", "amplitude_per_volt", "voltage"),
        *floats("drive_frequency", "drive_phase", "resonance_frequency", "modal_mass"),
        *floats("envelope_real", "envelope_imag"),
        *floats("envelope_age"),  # time since the envelope was written
        *floats("update_due"),  # time until the next update is due
        ("yields", np.uint8),  # one of the YIELDS_* of yielding.py in the open segment
        *floats("drive_force", "loss_force"),  # forces on it there [N]
        ("fine", np.uint8),  # whether drive and losses act in small steps, see resonator.py
        *floats("missing"),  # displacement that they have not given the vibration yet [m]
        *floats("ahead"),  # impulse of the drive that acted ahead of its time [N s]
        *floats("given"),  # impulse on the free mass by such a step at the last event [N s]
        *floats("drawn", "heat", "work", "pending"),
    ]
)


# Assumed, as the paper has no such transition: many periods of tool and drill, so that both follow,
# and a small part of the time for which a user drills.
SEATING_TIME = 0.1  # [s]
SEATING_STEPS = 20


def seating(before: DrillConstants, after: DrillConstants) -> list[tuple[float, DrillConstants]]:
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
