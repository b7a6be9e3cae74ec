"""Resets: what the collisions at one instant do, and which contacts remain closed after it.

    repeat until no touching pair approaches:
        actuator and free mass collide by eqs. (4)-(7)
        free mass and drill tool collide by eqs. (11)-(13), or share their momentum by eq. (21) in the rock
    keep the contacts that would close again at once and whose force is then a push

A free mass that chatters comes to rest in finite time. That is recognised when its next bounce would be lower than
``LOWEST_BOUNCE``: the contact is then kept, and left again when its force vanishes or another body strikes.
"""

import math
from typing import NamedTuple

from rpud_sim.model.collision import collide, common_velocity
from rpud_sim.model.compile import compiled
from rpud_sim.model.guards import SAME_VELOCITY
from rpud_sim.model.motion import (
    CONTACT_BOTH,
    drill_tool_closed_form,
    nodal_plane_closed_form,
)
from rpud_sim.model.segment import CONTACT_ACTUATOR, CONTACT_DRILL_TOOL
from rpud_sim.model.suspension import decaying_derivatives, decaying_part
from rpud_sim.model.vibration import TWO_PI, harmonic_vibration

LOWEST_BOUNCE = 1e-12  # [m]
SAME_ACCELERATION = 1e-6  # a contact that pulls by less still holds; its guard then decides [m/s^2]
MOST_COLLISIONS = 1000  # at one instant; then the bodies go on together


class Collisions(NamedTuple):
    """What the free mass did to the drill tool at one instant."""

    actuator_struck: bool
    drill_tool_struck: bool
    impact_velocity: float  # closing velocity of the first blow on the drill tool [m/s]
    energy: float  # kinetic energy of the free mass before that blow [J]
    impulse: float  # of all its blows on the drill tool [N s]


@compiled
def exchange_momentum(drill, state, closed):
    """Apply all collisions among the touching bodies; velocities in the state change, positions do not.

    Args:
        drill: the constants.
        state: the moving state.
        closed: CONTACT_* bits of the gaps that are closed.

    Returns:
        ``Collisions``.
    """
    _, v_hv = harmonic_vibration(state.amplitude, state.frequency, state.phase)
    v_ut = state.v_np + v_hv
    actuator_struck = False
    drill_tool_struck = False
    impact_velocity = 0.0
    energy = 0.0
    impulse = 0.0
    for count in range(MOST_COLLISIONS):
        approaching = False
        if closed & CONTACT_ACTUATOR and v_ut - state.v_fm > SAME_VELOCITY:
            approaching = True
            actuator_struck = True
            restitution = drill.actuator_restitution if count < MOST_COLLISIONS - 1 else 0.0
            v_ut, state.v_fm = collide(
                drill.rpud_mass, v_ut, drill.free_mass, state.v_fm, restitution
            )
        if closed & CONTACT_DRILL_TOOL and state.v_fm - state.v_dt > SAME_VELOCITY:
            approaching = True
            before = state.v_fm
            if not drill_tool_struck:
                impact_velocity = state.v_fm - state.v_dt
                energy = 0.5 * drill.free_mass * before * before
            drill_tool_struck = True
            restitution = 0.0 if drill.in_rock else drill.drill_tool_restitution
            state.v_fm, state.v_dt = collide(
                drill.free_mass, state.v_fm, drill.tool_mass, state.v_dt, restitution
            )
            impulse += drill.free_mass * (before - state.v_fm)
        if not approaching:
            break
    if closed & CONTACT_DRILL_TOOL and state.v_fm > state.v_dt:
        state.v_dt = state.v_fm
    if closed & CONTACT_ACTUATOR and v_ut > state.v_fm:
        v_ut = state.v_fm
        state.v_np = v_ut - v_hv
    if actuator_struck:
        state.v_np = v_ut - v_hv  # eq. (7)
    return Collisions(actuator_struck, drill_tool_struck, impact_velocity, energy, impulse)


@compiled
def tip_acceleration(drill, state, contact):
    """Acceleration of the actuator's tip under the given contact [m/s^2]."""
    motion = nodal_plane_closed_form(drill, state, contact)
    displacement, velocity = decaying_part(motion, 0.0)
    acceleration, _ = decaying_derivatives(motion, displacement, velocity)
    omega = TWO_PI * state.frequency
    in_phase, _ = harmonic_vibration(motion.vibration_sine + state.amplitude, 0.0, state.phase)
    in_quadrature, _ = harmonic_vibration(motion.vibration_cosine, 0.0, state.phase + 0.25)
    return acceleration - omega * omega * (in_phase + in_quadrature)


@compiled
def tool_acceleration(drill, state, contact):
    """Acceleration of the drill tool under the given contact, the actuator apart [m/s^2]."""
    motion = drill_tool_closed_form(drill, state, contact)
    displacement, velocity = decaying_part(motion, 0.0)
    acceleration, _ = decaying_derivatives(motion, displacement, velocity)
    return acceleration


@compiled
def returns_at_once(separation, closing_acceleration):
    """Whether two touching bodies that separate this slowly [m/s] are to be taken as staying together."""
    if separation <= SAME_VELOCITY:
        return True
    return (
        closing_acceleration > 0.0
        and separation * separation < 2.0 * closing_acceleration * LOWEST_BOUNCE
    )


@compiled
def hold_both(drill, state, v_ut, v_hv):
    """Keep all three bodies together if both contacts push; returns whether they do."""
    separate = state.v_np
    pair = common_velocity(drill.free_mass, state.v_fm, drill.tool_mass, state.v_dt)
    together = common_velocity(drill.rpud_mass, v_ut, drill.free_mass + drill.tool_mass, pair)
    state.v_np = together - v_hv
    acceleration = tip_acceleration(drill, state, CONTACT_BOTH)
    on_tool = (
        drill.tool_mass * acceleration
        + drill.tool_damping * together
        + drill.tool_spring_rate * state.u_dt
    )
    on_tip = on_tool + drill.free_mass * (acceleration - drill.gravity)
    if on_tool >= 0.0 and on_tip >= 0.0:
        state.v_fm = together
        state.v_dt = together
        return True
    state.v_np = separate
    return False


@compiled
def hold_on_drill_tool(drill, state, must_not_reach):
    """Keep the free mass on the drill tool if that pushes and does not run into the given acceleration."""
    separate = state.v_dt
    together = common_velocity(drill.free_mass, state.v_fm, drill.tool_mass, state.v_dt)
    state.v_dt = together
    acceleration = tool_acceleration(drill, state, CONTACT_DRILL_TOOL)
    if must_not_reach <= acceleration <= drill.gravity + SAME_ACCELERATION:
        state.v_fm = together
        return True
    state.v_dt = separate
    return False


@compiled
def hold_on_actuator(drill, state, v_ut, v_hv, must_not_reach):
    """Keep the free mass on the tip if that pushes and does not run into the given acceleration."""
    separate = state.v_np
    together = common_velocity(drill.rpud_mass, v_ut, drill.free_mass, state.v_fm)
    state.v_np = together - v_hv
    acceleration = tip_acceleration(drill, state, CONTACT_ACTUATOR)
    if drill.gravity - SAME_ACCELERATION <= acceleration <= must_not_reach:
        state.v_fm = together
        return True
    state.v_np = separate
    return False


@compiled
def lasting_contact(drill, state, closed, drill_tool_struck):
    """Which of the closed contacts last after the collisions; bodies that stay together get one velocity.

    Args:
        drill: the constants.
        state: the moving state after the collisions.
        closed: CONTACT_* bits of the gaps that are closed.
        drill_tool_struck: whether the drill tool was struck at this instant.

    Returns:
        CONTACT_* bits.
    """
    _, v_hv = harmonic_vibration(state.amplitude, state.frequency, state.phase)
    v_ut = state.v_np + v_hv
    tip = tip_acceleration(drill, state, 0)
    tool = tool_acceleration(drill, state, 0)
    on_tip = closed & CONTACT_ACTUATOR and returns_at_once(
        state.v_fm - v_ut, tip - drill.gravity
    )
    behind = tip if on_tip else drill.gravity
    on_tool = closed & CONTACT_DRILL_TOOL and returns_at_once(
        state.v_dt - state.v_fm, behind - tool
    )
    if on_tool and closed & CONTACT_ACTUATOR and not on_tip:
        ahead = tool_acceleration(drill, state, CONTACT_DRILL_TOOL)
        on_tip = returns_at_once(state.v_fm - v_ut, tip - ahead)
    if on_tool and on_tip and hold_both(drill, state, v_ut, v_hv):
        return CONTACT_BOTH
    if on_tool:
        if drill_tool_struck and drill.in_rock:
            # Eq. (21): from an impact on, they move together until the force returns to zero.
            return CONTACT_DRILL_TOOL
        if hold_on_drill_tool(drill, state, tip if on_tip else -math.inf):
            return CONTACT_DRILL_TOOL
    if on_tip and hold_on_actuator(drill, state, v_ut, v_hv, tool if on_tool else math.inf):
        return CONTACT_ACTUATOR
    return 0
