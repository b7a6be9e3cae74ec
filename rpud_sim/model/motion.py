"""Closed forms of the motion that follows a state, for each combination of contacts."""

from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_DRILL_TOOL,
    set_drill_tool_motion,
    set_nodal_plane_motion,
)
from rpud_sim.model.suspension import (
    Oscillation,
    Oscillator,
    driven_vibration,
    free_vibration,
    oscillator,
)
from rpud_sim.model.vibration import TWO_PI

CONTACT_BOTH = CONTACT_ACTUATOR | CONTACT_DRILL_TOOL


class Oscillators(NamedTuple):
    """The bodies that no vibration drives, each an ``Oscillator``."""

    nodal_plane: Oscillator  # the RPUD on its load spring
    tool: Oscillator
    pair: Oscillator  # tool and free mass as one body


@compiled
def oscillators_of(drill):
    """Return the ``Oscillators`` of a drill."""
    damping, spring_rate = drill.tool_damping, drill.tool_spring_rate
    return Oscillators(
        oscillator(drill.rpud_mass, drill.rpud_damping, drill.load_spring_rate),
        oscillator(drill.tool_mass, damping, spring_rate),
        oscillator(drill.free_mass + drill.tool_mass, damping, spring_rate),
    )


@compiled
def nodal_plane_closed_form(drill, bodies, state, turn):
    """Return the ``Oscillation`` of the nodal plane.

    Alone, or with the free mass in flight or on the drill tool, it obeys eq. (2) with the preload
    W, and its weight if gravity acts on it. With the free mass (and the drill tool behind it) held
    against the vibrating tip, their inertia and the drill tool's spring act on it as well, moved
    by u_hv of eq. (1).
    """
    force = state.weight_on_bit + drill.rpud_weight
    if not state.contact & CONTACT_ACTUATOR:
        return free_vibration(bodies.nodal_plane, force, state.u_np, state.v_np)
    carried = drill.free_mass
    damping = 0.0
    spring_rate = 0.0
    if state.contact == CONTACT_BOTH:
        carried += drill.tool_mass
        damping = drill.tool_damping
        spring_rate = drill.tool_spring_rate
    omega = TWO_PI * state.frequency
    body = oscillator(
        drill.rpud_mass + carried,
        drill.rpud_damping + damping,
        drill.load_spring_rate + spring_rate,
    )
    return driven_vibration(
        body,
        force + drill.free_mass * drill.gravity,
        (carried * omega * omega - spring_rate) * state.amplitude,
        -damping * omega * state.amplitude,
        state.frequency,
        turn,
        state.u_np,
        state.v_np,
    )


@compiled
def drill_tool_closed_form(drill, bodies, state):
    """Return that of the drill tool: alone by eq. (14), with the free mass by eq. (31)."""
    if state.contact == CONTACT_DRILL_TOOL:
        force = drill.free_mass * drill.gravity
        return free_vibration(bodies.pair, force, state.u_dt, state.v_dt)
    if state.tool_at_rest or state.contact == CONTACT_BOTH:
        return Oscillation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return free_vibration(bodies.tool, 0.0, state.u_dt, state.v_dt)


@compiled
def begin_segment(drill, bodies, state, segment, turn):
    """Write the closed form that follows from the state into a segment, all but its duration.

    ``turn`` is the ``Turn`` of the state's phase.
    """
    segment.start_seconds = state.seconds
    segment.start_fraction = state.fraction
    segment.contact = state.contact
    segment.event = state.event
    segment.vibration_phase = state.phase
    segment.vibration_frequency = state.frequency
    segment.vibration_amplitude = state.amplitude
    segment.weight_on_bit = state.weight_on_bit
    set_nodal_plane_motion(segment, nodal_plane_closed_form(drill, bodies, state, turn))
    set_drill_tool_motion(segment, drill_tool_closed_form(drill, bodies, state))
    segment.free_mass_position = state.u_fm
    segment.free_mass_velocity = state.v_fm
    segment.free_mass_acceleration = drill.gravity
    segment.load_spring_rate = drill.load_spring_rate
    segment.load_spring_damping = drill.rpud_damping
    segment.free_mass = drill.free_mass
    segment.drill_tool_mass = drill.tool_mass
    segment.drill_tool_spring_rate = drill.tool_spring_rate
    segment.drill_tool_damping = drill.tool_damping
    segment.gravity = drill.gravity
