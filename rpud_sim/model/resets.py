"""Resets: the collisions at one instant, and the contacts that remain closed after it.

Touching pairs collide until none approaches: actuator and free mass by eqs. (4)-(7), free mass and
drill tool by eqs. (11)-(13), or by eq. (21) in the rock and when jammed. Contacts that would close
again immediately are kept, if their forces push.

A chattering free mass comes to rest in finite time: where its next bounce would be lower than
``LOWEST_BOUNCE`` the contact is kept, until its force vanishes or another body strikes.
"""

import math
from typing import NamedTuple

from rpud_sim.model.closed_form import TWO_PI, vibration_of
from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import collide, common_velocity
from rpud_sim.model.resonator import apply_impact, tip_mass
from rpud_sim.model.segment import CONTACT_ACTUATOR, CONTACT_BOTH, CONTACT_DRILL_TOOL
from rpud_sim.model.tolerances import (
    LOWEST_BOUNCE,
    MOST_COLLISIONS,
    SAME_ACCELERATION,
    SAME_VELOCITY,
    TOUCHING,
    WEAKEST_PULL,
)
from rpud_sim.model.yielding import carrying_frequency, yielding_acceleration, yields


class Collisions(NamedTuple):
    """Result of the collisions at one instant."""

    actuator_struck: bool
    drill_tool_struck: bool
    impact_velocity: float  # closing velocity of the first blow on the drill tool [m/s]
    energy: float  # kinetic energy of the free mass before that blow [J]
    impulse: float  # impulse of all its blows on the drill tool [N s]
    energy_transferred: float  # energy that the drill tool and its blows take [J]


@compiled
def close_gaps(state, met, turn):
    """Find the pairs that touch, and push overlapping ones apart; never moves the nodal plane."""
    u_hv, _ = vibration_of(state.amplitude, state.frequency, turn)
    u_ut = state.u_np + u_hv
    closed = 0
    if met & CONTACT_ACTUATOR or state.u_fm - u_ut <= TOUCHING:
        closed |= CONTACT_ACTUATOR
        state.u_fm = max(state.u_fm, u_ut)
    if met & CONTACT_DRILL_TOOL or state.u_dt - state.u_fm <= TOUCHING:
        if closed:
            state.u_dt = max(state.u_dt, state.u_fm)
        else:
            state.u_fm = min(state.u_fm, state.u_dt)
        closed |= CONTACT_DRILL_TOOL
    return closed


@compiled
def pair_velocity(drill, state):
    """Velocity of free mass and drill tool that continue together."""
    return common_velocity(drill.free_mass, state.v_fm, drill.tool_mass, state.v_dt)


@compiled
def exchange_momentum(drill, state, closed, turn):
    """Apply all collisions among the touching bodies; only velocities change."""
    _, v_hv = vibration_of(state.amplitude, state.frequency, turn)
    v_ut = state.v_np + v_hv
    mass = tip_mass(drill, state)
    given = 0.0
    actuator_struck = False
    drill_tool_struck = False
    impact_velocity = 0.0
    energy = 0.0
    impulse = 0.0
    transferred = 0.0
    struck_mass = drill.free_mass
    wedged = drill.jammed and closed & CONTACT_DRILL_TOOL
    if wedged:
        struck_mass += drill.tool_mass
        if state.v_fm < state.v_dt:
            state.v_fm = state.v_dt = pair_velocity(drill, state)
    for count in range(MOST_COLLISIONS):
        approaching = False
        joining = wedged and state.v_fm - state.v_dt > SAME_VELOCITY
        if closed & CONTACT_ACTUATOR and v_ut - state.v_fm > SAME_VELOCITY and not joining:
            approaching = True
            actuator_struck = True
            restitution = drill.actuator_restitution if count < MOST_COLLISIONS - 1 else 0.0
            arriving = v_ut
            v_ut, state.v_fm = collide(mass, v_ut, struck_mass, state.v_fm, restitution)
            given += mass * (arriving - v_ut)
            if wedged:
                state.v_dt = state.v_fm
        if closed & CONTACT_DRILL_TOOL and state.v_fm - state.v_dt > SAME_VELOCITY:
            approaching = True
            before = state.v_fm
            if not drill_tool_struck:
                impact_velocity = state.v_fm - state.v_dt
                energy = 0.5 * drill.free_mass * before * before
            drill_tool_struck = True
            restitution = drill.drill_tool_restitution
            if drill.in_rock or wedged:
                restitution = 0.0
            state.v_fm, state.v_dt = collide(
                drill.free_mass, state.v_fm, drill.tool_mass, state.v_dt, restitution
            )
            impulse += drill.free_mass * (before - state.v_fm)
            transferred += 0.5 * drill.free_mass * (before * before - state.v_fm * state.v_fm)
        if not approaching:
            break
    if closed & CONTACT_DRILL_TOOL and state.v_fm > state.v_dt:
        state.v_fm = state.v_dt = pair_velocity(drill, state)
    if actuator_struck and state.resonant:
        apply_impact(drill, state, given)
    elif actuator_struck:
        state.v_np = v_ut - v_hv  # eq. (7)
    return Collisions(
        actuator_struck, drill_tool_struck, impact_velocity, energy, impulse, transferred
    )


@compiled
def tip_acceleration(drill, state, v_np, contact, turn):
    u_hv, v_hv = vibration_of(state.amplitude, state.frequency, turn)
    frequency = state.frequency
    if contact == CONTACT_ACTUATOR and state.resonant:
        frequency = carrying_frequency(drill, state)
    omega = TWO_PI * frequency
    mass = drill.rpud_mass
    force = state.weight_on_bit + drill.rpud_weight - mass * omega * omega * u_hv
    force -= drill.load_spring_rate * state.u_np + drill.rpud_damping * v_np
    if contact & CONTACT_ACTUATOR:
        mass += drill.free_mass
        force += drill.free_mass * drill.gravity
    if contact == CONTACT_BOTH:
        mass += drill.tool_mass
        force -= drill.tool_spring_rate * (state.u_np + u_hv)
        force -= drill.tool_damping * (v_np + v_hv)
    return force / mass


@compiled
def tool_acceleration(drill, state, v_dt, contact):
    mass = drill.tool_mass
    force = -drill.tool_spring_rate * state.u_dt - drill.tool_damping * v_dt
    if contact == CONTACT_DRILL_TOOL:
        mass += drill.free_mass
        force += drill.free_mass * drill.gravity
    elif state.tool_at_rest:
        return 0.0
    return force / mass


@compiled
def pushes(force):
    return force >= -0.5 * WEAKEST_PULL


@compiled
def returns_at_once(separation, closing_acceleration):
    """Whether touching bodies part so slowly [m/s] that they are taken to stay together."""
    if separation <= SAME_VELOCITY:
        return True
    return (
        closing_acceleration > 0.0
        and separation * separation < 2.0 * closing_acceleration * LOWEST_BOUNCE
    )


@compiled
def hold_both(drill, state, u_ut, v_ut, v_hv, stay, turn):
    """Keep all three bodies together if both contacts push; one that is jammed need not.

    ``stay``: whether both pairs stay together; if not, the free mass may still be caged. The drill
    tool is where the tip is, u_ut: there the forces must push.
    """
    pair = pair_velocity(drill, state)
    together = common_velocity(drill.rpud_mass, v_ut, drill.free_mass + drill.tool_mass, pair)
    if yields(state):
        acceleration = yielding_acceleration(drill, state, turn, together - v_hv)
    else:
        acceleration = tip_acceleration(drill, state, together - v_hv, CONTACT_BOTH, turn)
    on_tool = (
        drill.tool_mass * acceleration
        + drill.tool_damping * together
        + drill.tool_spring_rate * u_ut
    )
    on_tip = on_tool + drill.free_mass * (acceleration - drill.gravity)
    energy = 0.5 * (
        drill.rpud_mass * (v_ut - together) * (v_ut - together)
        + drill.free_mass * (state.v_fm - together) * (state.v_fm - together)
        + drill.tool_mass * (state.v_dt - together) * (state.v_dt - together)
    )
    caged = energy < min(on_tool, on_tip) * LOWEST_BOUNCE
    if not ((drill.jammed or pushes(on_tool)) and pushes(on_tip) and (stay or caged)):
        return False
    state.v_np = together - v_hv
    state.v_fm = state.v_dt = together
    return True


@compiled
def hold_on_drill_tool(drill, state, behind):
    """Keep the free mass on the drill tool if that pushes and the tip does not catch up."""
    together = pair_velocity(drill, state)
    acceleration = tool_acceleration(drill, state, together, CONTACT_DRILL_TOOL)
    force = drill.free_mass * (drill.gravity - acceleration)
    if not (pushes(force) and behind <= acceleration + SAME_ACCELERATION):
        return False
    state.v_fm = state.v_dt = together
    return True


@compiled
def hold_on_actuator(drill, state, v_ut, v_hv, ahead, turn):
    """Keep the free mass on the tip if that pushes and they do not catch up with the tool."""
    together = common_velocity(drill.rpud_mass, v_ut, drill.free_mass, state.v_fm)
    acceleration = tip_acceleration(drill, state, together - v_hv, CONTACT_ACTUATOR, turn)
    force = drill.free_mass * (acceleration - drill.gravity)
    if not (pushes(force) and acceleration <= ahead + SAME_ACCELERATION):
        return False
    state.v_np = together - v_hv
    state.v_fm = together
    return True


@compiled
def lasting_contact(drill, state, closed, opened, drill_tool_struck, turn):
    """Contacts that last after the collisions; bodies that stay together get one velocity.

    At most one combination of contacts has only pushing forces and no gap that closes again. Only
    pairs that separate slowly enough can be in it.
    """
    closed &= ~opened
    if not closed:
        return 0
    u_hv, v_hv = vibration_of(state.amplitude, state.frequency, turn)
    u_ut, v_ut = state.u_np + u_hv, state.v_np + v_hv
    tip = 0.0
    if closed & CONTACT_ACTUATOR:
        tip = tip_acceleration(drill, state, state.v_np, 0, turn)
    if drill.jammed and closed & CONTACT_DRILL_TOOL:
        wedged = tool_acceleration(drill, state, state.v_dt, CONTACT_DRILL_TOOL)
        if (
            closed & CONTACT_ACTUATOR
            and returns_at_once(state.v_fm - v_ut, tip - wedged)
            and hold_both(drill, state, u_ut, v_ut, v_hv, True, turn)
        ):
            return CONTACT_BOTH
        return CONTACT_DRILL_TOOL
    tool = 0.0
    if closed & CONTACT_DRILL_TOOL:
        tool = tool_acceleration(drill, state, state.v_dt, 0)
    on_tip = closed & CONTACT_ACTUATOR and returns_at_once(state.v_fm - v_ut, tip - drill.gravity)
    behind = max(tip, drill.gravity) if on_tip else drill.gravity
    on_tool = closed & CONTACT_DRILL_TOOL and returns_at_once(
        state.v_dt - state.v_fm, behind - tool
    )
    if on_tool and closed & CONTACT_ACTUATOR and not on_tip:
        ahead = tool_acceleration(drill, state, state.v_dt, CONTACT_DRILL_TOOL)
        on_tip = returns_at_once(state.v_fm - v_ut, tip - ahead)
    stay = on_tool and on_tip
    near = not opened and state.u_dt - u_ut <= LOWEST_BOUNCE
    if (stay or near) and hold_both(drill, state, u_ut, v_ut, v_hv, stay, turn):
        return CONTACT_BOTH
    if on_tool:
        if drill_tool_struck and drill.in_rock:
            # Eq. (21): from an impact on, they move together until the force returns to zero.
            return CONTACT_DRILL_TOOL
        if hold_on_drill_tool(drill, state, tip if on_tip else -math.inf):
            return CONTACT_DRILL_TOOL
    ahead = tool if on_tool else math.inf
    if on_tip and hold_on_actuator(drill, state, v_ut, v_hv, ahead, turn):
        return CONTACT_ACTUATOR
    return 0


@compiled
def join_held_bodies(state, turn):
    """Give bodies that are held together one position; never moves the nodal plane."""
    if state.contact & CONTACT_ACTUATOR:
        u_hv, _ = vibration_of(state.amplitude, state.frequency, turn)
        state.u_fm = state.u_np + u_hv
        if state.contact & CONTACT_DRILL_TOOL:
            state.u_dt = state.u_fm
    elif state.contact & CONTACT_DRILL_TOOL:
        state.u_fm = state.u_dt
