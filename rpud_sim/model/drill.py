"""Drill of the engine: constants derived from the parameters, and the moving state."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rpud_sim.model.closed_form import (
    NO_SWING,
    TWO_PI,
    damping_coefficient,
    decaying_amplitude,
    swinging_part,
)
from rpud_sim.model.compile import compiled, floats, record_type
from rpud_sim.model.contact import effective_tool, half_sine_impulse
from rpud_sim.model.elementary import arc_tangent, power
from rpud_sim.model.energy import drill_tool_damper_loss
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.search import force_of_swing, force_on_drill_tool
from rpud_sim.model.segment import (
    CONTACT_BOTH,
    drill_tool_motion,
    nodal_plane_integral,
    tip_motion,
    vibration_turn,
)

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
        ("tool_at_rest", np.uint8),  # in the rock, between two contacts
        *floats("u_np", "v_np", "u_fm", "v_fm", "u_dt", "v_dt"),
        ("next_event", np.uint8),  # what ends the open segment, an END_* of search.py
        ("impacts", np.uint64),  # on the drill tool, so far
        ("impact_open", np.uint8),  # whether the last of them is still in contact
        ("standstill", np.int64),  # events in a row without time passing
        *floats("effort"),  # on the event budget, see tolerances.py
        # Of a resonant vibration, see resonator.py; all else is zero if it is prescribed.
        ("resonant", np.uint8),
        ("steady", np.uint8),  # no update until a contact or a command
        *floats("decay_time", "resistance", "amplitude_per_volt", "voltage"),
        *floats("drive_frequency", "drive_phase", "resonance_frequency"),
        *floats("envelope_real", "envelope_imag"),
        *floats("envelope_age"),  # time since the envelope was written
        *floats("update_due"),  # time until the next update is due
        *floats("drawn", "heat", "work", "owed"),
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


# Samples of the contact force in which its maximum is sought while all three bodies are in contact.
FORCE_SAMPLES = 64


@compiled
def peak_of_pair(segment, time, swing):
    """Greatest force on the drill tool off the actuator, in the first part of a segment [N]."""
    start, _ = force_of_swing(segment, NO_SWING)
    end, slope = force_of_swing(segment, swing)
    greatest = max(start, end)
    # Eq. (38): the force is greatest where the acceleration is least.
    motion = drill_tool_motion(segment)
    w = motion.angular_frequency
    if motion.decay_rate == 0.0:
        # It rises up to its crest, and the next half cycle it falls.
        half = w * time > math.pi
        falls = slope < 0.0
        passed = half or falls if motion.sine > 0.0 else (half and falls) or w * time > TWO_PI
        if passed:
            pull = w * w * decaying_amplitude(motion)
            greatest = max(greatest, segment.free_mass * (segment.gravity + pull))
        return greatest
    lag = arc_tangent(w, -motion.decay_rate)
    angle = arc_tangent(motion.sine, motion.cosine)
    angle += 1.5 * math.pi - 3.0 * lag
    while angle < 0.0:
        angle += TWO_PI
    if angle < w * time:
        force, _ = force_on_drill_tool(segment, angle / w)
        greatest = max(greatest, force)
    return greatest


@compiled
def peak_of_three(segment, time):
    """Return the same while all three bodies are in contact, by samples."""
    start, _ = force_on_drill_tool(segment, 0.0)
    end, _ = force_on_drill_tool(segment, time)
    greatest = max(start, end)
    step = time / FORCE_SAMPLES
    for i in range(1, FORCE_SAMPLES):
        force, slope = force_on_drill_tool(segment, i * step)
        _, slope_after = force_on_drill_tool(segment, (i + 1) * step)
        if slope > 0.0 >= slope_after:
            crest = (i + slope / (slope - slope_after)) * step
            force, _ = force_on_drill_tool(segment, crest)
        greatest = max(greatest, force)
    return greatest


@compiled
def open_impact(drill, state, impact, collisions):
    impact.sequence = state.impacts
    impact.seconds = state.seconds
    impact.fraction = state.fraction
    impact.impact_velocity = collisions.impact_velocity
    impact.energy = collisions.energy
    impact.impulse = collisions.impulse
    impact.energy_transferred = collisions.energy_transferred
    # In the rock the contact tells, if it lasts.
    impact.squeezed = state.contact == CONTACT_BOTH and not drill.in_rock
    impact.peak_force = 0.0
    impact.contact_duration = 0.0
    state.impacts += 1
    if drill.in_rock:
        state.impact_open = 1
        return
    restitution = 0.0 if drill.jammed else drill.drill_tool_restitution
    velocity, spring_rate = collisions.impact_velocity, drill.tool_elasticity
    peak_force, duration, _ = half_sine_impulse(
        drill.free_mass, drill.tool_mass, restitution, velocity, spring_rate
    )
    impact.peak_force = peak_force
    impact.contact_duration = duration


@compiled
def follow_impact(segment, impact, time, turns):
    """Add the first part of a segment in contact to the record of the impact."""
    mass, spring_rate = segment.drill_tool_mass, segment.drill_tool_spring_rate
    if segment.contact == CONTACT_BOTH:
        turn = vibration_turn(segment, 0.0)
        _, _, u_start, v_start = tip_motion(segment, turn, NO_SWING)
        _, _, u_end, v_end = tip_motion(segment, turns.vibration, turns.nodal_plane)
        vibration = segment.vibration_amplitude * (turn.cosine - turns.vibration.cosine)
        omega = TWO_PI * segment.vibration_frequency
        integral = nodal_plane_integral(segment, time, turn, turns) + vibration / omega
        impact.impulse += (
            mass * (v_end - v_start)
            + segment.drill_tool_damping * (u_end - u_start)
            + spring_rate * integral
        )
        if time > 0.0:
            impact.squeezed = True
        force = peak_of_three(segment, time)
    else:
        motion, offset = drill_tool_motion(segment), segment.drill_tool_offset
        displacement, v_start = swinging_part(motion, NO_SWING)
        u_start = offset + displacement
        displacement, v_end = swinging_part(motion, turns.drill_tool)
        u_end = offset + displacement
        impact.impulse += segment.free_mass * (segment.gravity * time - (v_end - v_start))
        force = peak_of_pair(segment, time, turns.drill_tool)
    moved = mass * (v_end - v_start) * (v_end + v_start)
    strained = spring_rate * (u_end - u_start) * (u_end + u_start)
    loss = drill_tool_damper_loss(segment, 0.0, time, NO_SWING, turns.drill_tool)
    impact.energy_transferred += 0.5 * (moved + strained) + loss
    impact.contact_duration += time
    impact.peak_force = max(impact.peak_force, force)
