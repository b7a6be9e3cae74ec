"""Impact in progress: from the blow on the drill tool to the end of that contact.

It ends when the contact opens or comes to rest, when the free mass strikes the tool again, when
the actuator strikes a jammed free mass, and when the rock is left.
"""

import math

from rpud_sim.model.closed_form import (
    NO_SWING,
    TWO_PI,
    decaying_amplitude,
    swinging_part,
    swung_integral,
)
from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import half_sine_impulse
from rpud_sim.model.elementary import arc_tangent
from rpud_sim.model.integrals import drill_tool_damper_loss
from rpud_sim.model.search import force_of_swing, force_on_drill_tool
from rpud_sim.model.segment import (
    CONTACT_BOTH,
    drill_tool_motion,
    nodal_plane_integral,
    tip_motion,
    vibration_turn,
)

# Samples of the contact force in which its maximum is sought while all three bodies are in contact,
# and in a step in which the vibration yields: an eighth of a cycle.
FORCE_SAMPLES = 64
SAMPLES_OF_STEP = 4


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
    first, samples = 1, FORCE_SAMPLES
    if segment.drill_tool_angular_frequency != 0.0:
        first, samples = 0, SAMPLES_OF_STEP
    step = time / samples
    for i in range(first, samples):
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
    # In the rock the contact shows, if it lasts.
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
        motion = drill_tool_motion(segment)
        if motion.angular_frequency != 0.0:
            integral += motion.offset * time + swung_integral(motion, turns.drill_tool)
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
