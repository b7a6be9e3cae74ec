"""Impact in progress: from the blow on the drill tool to the end of that contact.

It ends when the contact opens or comes to rest, when the free mass strikes the tool again, when
the actuator strikes a jammed free mass, and when the rock is left.
"""

import math

from rpud_sim.model.closed_form import NO_SWING, TWO_PI, decaying_amplitude, swinging_part
from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import half_sine_impulse
from rpud_sim.model.elementary import arc_tangent
from rpud_sim.model.energy import drill_tool_damper_loss
from rpud_sim.model.search import force_of_swing, force_on_drill_tool
from rpud_sim.model.segment import (
    CONTACT_BOTH,
    CONTACT_DRILL_TOOL,
    Turns,
    drill_tool_motion,
    nodal_plane_integral,
    tip_motion,
    vibration_turn,
)

# Samples of the contact force in which its maximum is sought while all three bodies are in contact.
FORCE_SAMPLES = 64


@compiled
def tip_integral(segment, time, turns):
    """Integral of u_ut over the first part of a segment, given the ``Turns`` at its end [m s]."""
    start = vibration_turn(segment, 0.0)
    vibration = segment.vibration_amplitude * (start.cosine - turns.vibration.cosine)
    omega = TWO_PI * segment.vibration_frequency
    return nodal_plane_integral(segment, time, start, turns) + vibration / omega


@compiled
def drill_tool_of(segment, turns):
    """Position [m] and velocity [m/s] of the drill tool in contact, given the ``Turns``."""
    if segment.contact == CONTACT_BOTH:
        _, _, u_ut, v_ut = tip_motion(segment, turns.vibration, turns.nodal_plane)
        return u_ut, v_ut
    displacement, v_dt = swinging_part(drill_tool_motion(segment), turns.drill_tool)
    return segment.drill_tool_offset + displacement, v_dt


@compiled
def contact_impulse(segment, time, start, end, turns):
    """Momentum that the drill tool receives in the first part of a segment in contact [N s].

    ``start`` and ``end`` are position and velocity of the drill tool there.
    """
    u_start, v_start = start
    u_end, v_end = end
    if segment.contact == CONTACT_BOTH:
        return (
            segment.drill_tool_mass * (v_end - v_start)
            + segment.drill_tool_damping * (u_end - u_start)
            + segment.drill_tool_spring_rate * tip_integral(segment, time, turns)
        )
    return segment.free_mass * (segment.gravity * time - (v_end - v_start))


@compiled
def energy_into_drill_tool(segment, time, start, end):
    """Energy that the drill tool receives in the first part of a segment in contact [J]."""
    u_start, v_start = start
    u_end, v_end = end
    motion = segment.drill_tool_mass * (v_end - v_start) * (v_end + v_start)
    strain = segment.drill_tool_spring_rate * (u_end - u_start) * (u_end + u_start)
    return 0.5 * (motion + strain) + drill_tool_damper_loss(segment, 0.0, time)


@compiled
def greatest_contact_force(segment, time, turns):
    """Greatest force on the drill tool in the first part of a segment in contact [N]."""
    if segment.contact == CONTACT_DRILL_TOOL:
        start, _ = force_of_swing(segment, NO_SWING)
        end, slope = force_of_swing(segment, turns.drill_tool)
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
    """Begin the record of an impact at the state's time."""
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
    peak_force, duration, _ = half_sine_impulse(
        drill.free_mass,
        drill.tool_mass,
        0.0 if drill.jammed else drill.drill_tool_restitution,
        collisions.impact_velocity,
        drill.tool_elasticity,
    )
    impact.peak_force = peak_force
    impact.contact_duration = duration


@compiled
def follow_impact(segment, impact, time, turns):
    """Add the first part of a segment in contact to the record of the impact."""
    turn = turns.vibration
    if segment.contact == CONTACT_BOTH:
        turn = vibration_turn(segment, 0.0)
    start = drill_tool_of(segment, Turns(turn, NO_SWING, NO_SWING))
    end = drill_tool_of(segment, turns)
    impact.impulse += contact_impulse(segment, time, start, end, turns)
    impact.energy_transferred += energy_into_drill_tool(segment, time, start, end)
    if segment.contact == CONTACT_BOTH and time > 0.0:
        impact.squeezed = True
    impact.contact_duration += time
    impact.peak_force = max(impact.peak_force, greatest_contact_force(segment, time, turns))
