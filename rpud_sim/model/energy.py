"""Energy account of a trajectory: work, losses and what is stored, from its closed forms.

It is an audit: of a run it takes nothing but the segments, and none of the engine's sums. It
integrates powers, and takes impulses from the velocities at an event. So its residual shows every
segment that breaks its equation of motion, and every event that breaks the conservation of
momentum. The integrals (``integrals.py``) are the engine's, too; tests compare them with
quadrature.
"""

from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.integrals import (
    damper_loss,
    drill_tool_damper_loss,
    growth_over,
    held_motion,
    square_integral,
    travel_of,
    vibration_work,
)
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_BOTH,
    CONTACT_DRILL_TOOL,
    EVENT_COMMAND,
    EVENT_RELEASE,
    drill_tool_motion,
    nodal_plane_motion,
)
from rpud_sim.model.tolerances import LEAST_DEFORMATION, LOWEST_BOUNCE, SAME_VELOCITY, TOUCHING

# Numbers of an account's terms, in joules: what flows in,
ACTUATOR_WORK, WEIGHT_ON_BIT_WORK, GRAVITY_WORK, CHANGES = range(4)
# what is lost,
LOAD_DAMPER, DRILL_TOOL_DAMPER, ACTUATOR_COLLISIONS, IMPACTS = range(4, 8)
RELEASE, CONTACT_RESOLUTION = 8, 9
# and what is stored in motion and springs more than at the start.
STORED = 10

TERMS = (
    "actuator_work",
    "weight_on_bit_work",
    "gravity_work",
    "changes",
    "load_damper",
    "drill_tool_damper",
    "actuator_collisions",
    "impacts",
    "release",
    "contact_resolution",
    "stored",
)


class RpudConstants(NamedTuple):
    """Constants of the RPUD that an account needs beside the segments."""

    mass: float  # m_ud [kg]
    gravity_acts: bool  # whether gravity acts on the RPUD, not on the free mass alone
    per_modal_mass: float  # 1 / M of the vibration, unless at rest [1/kg]; zero if blows leave it


@compiled
def held_travels(segment, held, duration):
    """Travels of nodal plane and held free mass [m], and the loss of the load spring's damping [J].

    Differences of positions would lose the digits that the deflection of a soft spring takes.
    """
    decaying, added, rate, steady, _, turn, omega = held
    swing = growth_over(omega, duration)
    nodal_plane = (decaying * growth_over(rate, duration)).real + (steady * swing).real
    vibration = complex(0.0, -segment.vibration_amplitude) * turn
    loss = segment.load_spring_damping * square_integral(
        rate * decaying, rate, omega * steady, omega, duration
    )
    tip = (added * growth_over(rate, duration)).real + (vibration * swing).real
    return nodal_plane, nodal_plane + tip, loss


@compiled
def free_travels(segment, start, end, begun, ended):
    """Return the same of a free mass off the tip, given the ``Turns`` at start and end."""
    motion = nodal_plane_motion(segment)
    nodal_plane = travel_of(motion, begun.nodal_plane, ended.nodal_plane)
    damping = segment.load_spring_damping
    loss = damper_loss(damping, motion, begun.nodal_plane, ended.nodal_plane)
    if segment.contact & CONTACT_DRILL_TOOL:
        free_mass = travel_of(drill_tool_motion(segment), begun.drill_tool, ended.drill_tool)
    else:
        mean = segment.free_mass_velocity + 0.5 * segment.free_mass_acceleration * (start + end)
        free_mass = mean * (end - start)
    return nodal_plane, free_mass, loss


@compiled
def stored_energy(segment, motion, rpud_mass):
    """Energy of motion and springs, given ``motion_at`` a time in a segment [J]."""
    u_np, v_np, _, _, _, v_fm, u_dt, v_dt = motion
    return 0.5 * (
        rpud_mass * v_np * v_np
        + segment.load_spring_rate * u_np * u_np
        + segment.free_mass * v_fm * v_fm
        + segment.drill_tool_mass * v_dt * v_dt
        + segment.drill_tool_spring_rate * u_dt * u_dt
    )


@compiled
def add_motion(rpud, segment, start, end, begun, ended, account):
    """Add what happens in a part of a segment, given the ``Turns`` at its start and end."""
    account[DRILL_TOOL_DAMPER] += drill_tool_damper_loss(
        segment, start, end, begun.drill_tool, ended.drill_tool
    )
    if segment.contact & CONTACT_ACTUATOR:
        held, duration = held_motion(segment, start), end - start
        nodal_plane, free_mass, loss = held_travels(segment, held, duration)
        account[ACTUATOR_WORK] += vibration_work(segment, held, duration)
    else:
        nodal_plane, free_mass, loss = free_travels(segment, start, end, begun, ended)
    account[WEIGHT_ON_BIT_WORK] += segment.weight_on_bit * nodal_plane
    gravity_work = segment.free_mass * segment.gravity * free_mass
    if rpud.gravity_acts:
        gravity_work += rpud.mass * segment.gravity * nodal_plane
    account[GRAVITY_WORK] += gravity_work
    account[LOAD_DAMPER] += loss


@compiled
def withdrawal_work(segment, tool_spring_rate, motion, passed):
    """Work on the springs of the drill while their mount withdraws from the bodies [J].

    The spring of the rock does not move with the mount. ``motion`` is the motion before it,
    ``passed`` the distance by which the origin of all displacements passes the bodies [m], and
    ``tool_spring_rate`` the drill tool's rate on the other side of this instant [N/m].
    """
    u_np, _, _, _, _, _, u_dt, _ = motion
    softer = min(segment.drill_tool_spring_rate, tool_spring_rate)
    at_np = segment.load_spring_rate * (passed - 2.0 * u_np)
    return 0.5 * passed * (at_np + softer * (passed - 2.0 * u_dt))


@compiled
def rests(segment):
    """Whether the drill tool is at rest at zero."""
    return (
        not segment.contact & CONTACT_DRILL_TOOL
        and segment.drill_tool_cosine == 0.0
        and segment.drill_tool_sine == 0.0
    )


@compiled
def starts_from_rest(segment, motion):
    """Whether a vibration at rest begins to yield here; no blow at this instant has moved it."""
    u_np, v_np, u_ut, v_ut = motion[:4]
    still = abs(u_ut - u_np) <= TOUCHING and abs(v_ut - v_np) <= SAME_VELOCITY
    return still and segment.contact == CONTACT_BOTH


@compiled
def add_change(before, after, motion, begun, account):
    """Add what new constants and a new origin do to springs and drill tool; returns the motion.

    ``motion`` is ``motion_at`` the instant, ``begun`` that after it and after its collisions.
    """
    tool_rate, new_rate = before.drill_tool_spring_rate, after.drill_tool_spring_rate
    same = before.load_spring_rate == after.load_spring_rate and tool_rate == new_rate
    same = same and before.drill_tool_mass == after.drill_tool_mass
    commanded = after.event & EVENT_COMMAND
    if same and not commanded:
        return motion
    passed = motion[0] - begun[0]
    # Nothing else moves the nodal plane immediately, or stops a drill tool away from zero.
    if not commanded or abs(passed) <= LEAST_DEFORMATION:
        passed = 0.0  # rounding
    u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt = motion
    account[CHANGES] += withdrawal_work(after, tool_rate, motion, passed)
    strain = u_dt  # where the stiffer spring of the drill tool acts
    u_dt -= passed
    met = commanded and new_rate != tool_rate and abs(begun[6]) <= LEAST_DEFORMATION
    if met and (rests(after) or abs(u_dt) > LOWEST_BOUNCE):
        softer = min(tool_rate, new_rate)
        account[RELEASE] += 0.5 * (before.drill_tool_mass * v_dt * v_dt + softer * u_dt * u_dt)
        u_dt = v_dt = 0.0
    if new_rate > tool_rate:
        strain = u_dt
    account[CHANGES] += 0.5 * (
        (after.load_spring_rate - before.load_spring_rate) * u_np * u_np
        + (after.drill_tool_mass - before.drill_tool_mass) * v_dt * v_dt
        + (new_rate - tool_rate) * strain * strain
    )
    return u_np - passed, v_np, u_ut - passed, v_ut, u_fm - passed, v_fm, u_dt, v_dt


@compiled
def add_rest(segment, after, ended, account):
    """Add what the rock takes of a tool that stops and is met or pushed at the same instant.

    ``ended`` is ``motion_at`` the end of the segment; returns the motion in which the tool rests.
    """
    u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt = ended
    met = not segment.contact & CONTACT_DRILL_TOOL and not rests(after)
    # Without a contact that could end, a release means that the rock releases the tool.
    if met and after.event & EVENT_RELEASE and abs(u_dt) <= LEAST_DEFORMATION:
        motion = segment.drill_tool_mass * v_dt * v_dt
        account[RELEASE] += 0.5 * (motion + segment.drill_tool_spring_rate * u_dt * u_dt)
        return u_np, v_np, u_ut, v_ut, u_fm, v_fm, 0.0, 0.0
    return ended


@compiled
def add_event(rpud, before, after, segment, account):
    """Add the collisions and the release at the event that begins a segment, given the motions."""
    _, np_before, _, _, _, fm_before, u_before, dt_before = before
    _, np_after, _, ut_after, _, fm_after, u_after, dt_after = after
    tool_mass, tool_spring_rate = segment.drill_tool_mass, segment.drill_tool_spring_rate
    from_tip = rpud.mass * (np_before - np_after)  # impulse on the free mass [N s]
    vibration = ut_after - np_after
    vibration_before = vibration
    if segment.vibration_amplitude > 0.0 and not starts_from_rest(segment, after):
        vibration_before += from_tip * rpud.per_modal_mass
    if rests(segment):
        # The rock has taken what motion and strain the impact left to the drill tool.
        on_tool = from_tip - segment.free_mass * (fm_after - fm_before)
        dt_after = dt_before + on_tool / tool_mass
        account[RELEASE] += 0.5 * (
            tool_mass * dt_after * dt_after + tool_spring_rate * u_before * u_before
        )
    else:
        on_tool = tool_mass * (dt_after - dt_before)
        account[CONTACT_RESOLUTION] += (
            0.5 * tool_spring_rate * (u_before - u_after) * (u_before + u_after)
        )
    fm = 0.5 * (fm_before + fm_after)
    tip = 0.5 * (np_before + np_after + vibration_before + vibration)
    account[ACTUATOR_WORK] += from_tip * 0.5 * (vibration_before + vibration)
    # In blows on both at one instant the mean velocities show the loss of both together alone.
    both = min(abs(from_tip), abs(on_tool)) > segment.free_mass * SAME_VELOCITY
    account[IMPACTS if both else ACTUATOR_COLLISIONS] += from_tip * (tip - fm)
    account[IMPACTS] += on_tool * (fm - 0.5 * (dt_before + dt_after))
