"""Events of the drill, and the exact advance from one to the next.

    until the requested time:
        the open segment ends at its event (search.py)
        close it, move the state there
        let the bodies collide and decide which contacts last (resets.py)
        write the closed form that follows (segment.py), find its event

The result does not depend on where a caller stops: a segment's event is computed once, from its
start, however many calls it takes to reach it.
"""

import math

from rpud_sim.model import resonator, segment_vibration, tolerances
from rpud_sim.model.closed_form import advance_phase, turn_at
from rpud_sim.model.compile import compiled
from rpud_sim.model.impact import follow_impact, open_impact
from rpud_sim.model.resets import close_gaps, exchange_momentum, join_held_bodies, lasting_contact
from rpud_sim.model.search import (
    END_AMPLITUDE,
    END_DRILL_TOOL_RELEASE,
    END_DRILL_TOOL_REST,
    END_LIMIT,
    next_event,
)
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_DRILL_TOOL,
    EVENT_ACTUATOR_IMPACT,
    EVENT_COMMAND,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_LIMIT,
    EVENT_RELEASE,
    begin_segment,
    motion_of,
    oscillators_of,
    turns_at,
    turns_at_end,
)

# How an advance ends: at the requested time, with no space for more results, in a standstill, with
# more events than their budget, or with a motion that is not finite. And that it has not ended yet.
DONE, FULL, STALLED, OVERLOADED, NOT_FINITE, RUNNING = range(6)

# Impacts that one event can end.
IMPACTS_OF_EVENT = 2

# Of each END_* but END_LIMIT: pairs whose approach ends, contacts that open for want of force, and
# EVENT_* bits of what is known to happen.
HAPPENS = (
    (CONTACT_ACTUATOR, 0, 0),
    (CONTACT_DRILL_TOOL, 0, 0),
    (0, CONTACT_ACTUATOR, EVENT_RELEASE),
    (0, CONTACT_DRILL_TOOL, EVENT_RELEASE),
    (0, 0, EVENT_RELEASE),
    (0, 0, EVENT_COMMAND),
)


@compiled
def end_segment(drill, state, segment, impact, time, turns):
    """Follow the open segment to a time after its start, and move the state there."""
    if state.impact_open:
        follow_impact(segment, impact, time, turns)
    u_np, v_np, _, _, u_fm, v_fm, u_dt, v_dt = motion_of(segment, time, turns)
    state.u_np, state.v_np = u_np, v_np
    state.u_fm, state.v_fm = u_fm, v_fm
    state.u_dt, state.v_dt = u_dt, v_dt
    fraction = state.fraction + time
    whole = math.floor(fraction)
    state.seconds += int(whole)
    state.fraction = fraction - whole
    state.effort = max(state.effort - tolerances.EVENT_BUDGET * time, 0.0)
    if state.resonant:
        segment_vibration.end_vibration(drill, state, segment, time, turns)
    else:
        state.phase = advance_phase(state.phase, state.frequency, time)


@compiled
def settle(drill, state, impact, impacts, count, turn, met, opened, event):
    """Resolve what happens at the state's instant, given the EVENT_* bits that are known.

    Returns the number of finished impacts, and the ``PhaseSinCos`` of the vibration.
    """
    v_np = state.v_np
    closed = close_gaps(state, met, turn)
    collisions = exchange_momentum(drill, state, closed, turn)
    if state.resonant:  # a blow changes the phase
        turn = turn_at(state.phase)
    struck = collisions.actuator_struck or collisions.drill_tool_struck
    if struck:
        opened = 0
    alone = state.v_np
    state.contact = lasting_contact(
        drill, state, closed, opened, collisions.drill_tool_struck, turn
    )
    if state.resonant and state.v_np != alone:
        resonator.apply_hold_impulse(
            drill, state, alone, drill.rpud_mass * (v_np - alone) + state.given
        )
    in_contact = state.contact & CONTACT_DRILL_TOOL
    join_held_bodies(state, turn)
    if state.resonant and state.fine and closed & CONTACT_ACTUATOR & ~state.contact:
        given = drill.rpud_mass * (v_np - state.v_np) + state.given
        segment_vibration.draw_back(state, given)
        turn = turn_at(state.phase)
    if collisions.actuator_struck or abs(state.v_np - v_np) > tolerances.SAME_VELOCITY:
        event |= EVENT_ACTUATOR_IMPACT
    impacted = collisions.impact_velocity > tolerances.SLOWEST_IMPACT
    if impacted:
        event |= EVENT_DRILL_TOOL_IMPACT
    over = impacted or not in_contact or not drill.in_rock
    over = over or (drill.jammed and collisions.actuator_struck)
    if state.impact_open and over:
        impacts[count] = impact
        count += 1
        state.impact_open = 0
    if impacted:
        open_impact(drill, state, impact, collisions)
        if not state.impact_open:
            impacts[count] = impact
            count += 1
    if drill.in_rock:
        slow = abs(state.v_dt) <= tolerances.SAME_VELOCITY
        unbent = state.u_dt <= (tolerances.LEAST_DEFORMATION if slow else 0.0)
        state.tool_at_rest = not in_contact and unbent
        if state.tool_at_rest:
            state.u_dt = state.v_dt = 0.0
    state.event = event
    return count, turn


@compiled
def open_segment(drill, bodies, state, segment, turn):
    """Write the segment that follows from the state, with its event and duration."""
    begin_segment(drill, bodies, state, segment, turn)
    state.effort += 1.0
    duration, end = next_event(drill, state, segment, turn)
    segment.duration = duration
    state.next_event = end
    state.standstill = state.standstill + 1 if duration <= tolerances.SHORTEST_SEGMENT else 0


@compiled
def pass_event(drill, bodies, state, segment, after, impact, impacts, count, turns):
    """Go through the event that ends a segment, and write the segment ``after`` it (or over it).

    Returns the number of finished impacts, and the ``PhaseSinCos`` at the start of that segment.
    """
    end = state.next_event
    stepped = state.resonant and segment_vibration.follows(state)
    end_segment(drill, state, segment, impact, segment.duration, turns)
    turn = turn_at(state.phase) if state.yields or stepped else turns.vibration
    stepped = stepped and end == END_AMPLITUDE
    if stepped:
        state.effort -= 1.0 - tolerances.SHARE_OF_STEP
    if stepped or end == END_LIMIT:
        state.event = EVENT_LIMIT
        if state.impact_open and impact.contact_duration >= tolerances.LONGEST_SEGMENT:
            impacts[count] = impact
            count += 1
            state.impact_open = 0
    if end != END_LIMIT:
        if end == END_AMPLITUDE and not stepped:
            if state.resonant:
                resonator.update(state)
            else:
                state.amplitude = state.target_amplitude
                # The sine is exactly zero here, so that the tip does not jump.
                state.phase = 0.5 if 0.25 < state.phase < 0.75 else 0.0
            turn = turn_at(state.phase)
        elif end == END_DRILL_TOOL_REST:
            state.u_dt = state.v_dt = 0.0
        met, opened, event = HAPPENS[end]
        count, turn = settle(drill, state, impact, impacts, count, turn, met, opened, event)
    # Called in one place alone, so that it is compiled into the loop.
    open_segment(drill, bodies, state, after, turn)
    return count, turn


@compiled
def status_before(state, segment, seconds, fraction, is_full):
    """How an advance to a time ends before the open segment's event; RUNNING if it does not."""
    ahead = float(seconds - state.seconds) + (fraction - state.fraction)
    if segment.duration > ahead:
        return DONE
    if is_full:
        return FULL
    if state.standstill > tolerances.LONGEST_STANDSTILL:
        return STALLED
    if state.effort > tolerances.GREATEST_EFFORT:
        return OVERLOADED
    return RUNNING


@compiled
def checked(status, state):
    """Return a status, or NOT_FINITE where numbers that all others follow from are not finite."""
    zero = 0.0 * state.u_np + 0.0 * state.v_np + 0.0 * state.u_fm + 0.0 * state.v_fm
    zero += 0.0 * state.u_dt + 0.0 * state.v_dt
    zero += 0.0 * state.amplitude + 0.0 * state.frequency + 0.0 * state.pending
    return status if status != DONE or zero == 0.0 else NOT_FINITE


@compiled
def advance(
    drill, states, open_segments, open_impacts, seconds, fractions, segments, impacts, counts, begun
):
    """Advance to times one after the other, as far as the space for results reaches.

    ``segments`` is space for finished segments and the open one, ``impacts`` for two more.
    ``counts`` gets the numbers of both that are finished at each time. ``begun`` and, after the
    status, the result are the numbers of times, segments and impacts that are there.
    """
    state = states[0]
    impact = open_impacts[0]
    bodies = oscillators_of(drill)
    last, most = len(segments) - 1, len(impacts) - IMPACTS_OF_EVENT
    reached, written, struck = begun
    status = DONE
    segments[written] = open_segments[0]
    while reached < len(seconds):
        segment = segments[written]
        is_full = written == last or struck > most
        status = status_before(state, segment, seconds[reached], fractions[reached], is_full)
        if status == RUNNING:
            written += 1
            turns = turns_at_end(segment, state.next_event == END_DRILL_TOOL_RELEASE)
            struck, _ = pass_event(
                drill, bodies, state, segment, segments[written], impact, impacts, struck, turns
            )
            continue
        if status != DONE:
            break
        counts[reached, 0] = written
        counts[reached, 1] = struck
        reached += 1
    open_segments[0] = segments[written]
    return checked(status, state), reached, written, struck


@compiled
def interrupt(drill, states, open_segments, open_impacts, time, segments, impacts, new):
    """End the open segment early, continue with what is new; return the number of finished impacts.

    New are weight on bit [N], amplitude [m] (voltage [V] of a resonance), frequency and resonance
    frequency [Hz], the distance by which the origin of all displacements passes the bodies [m], and
    whether the drill tool meets rock at zero.
    """
    state = states[0]
    segment = open_segments[0]
    impact = open_impacts[0]
    end_segment(drill, state, segment, impact, time, turns_at(segment, time))
    segments[0] = segment
    segments[0].duration = time
    weight_on_bit, level, frequency, resonance_frequency, passed, grips = new
    state.weight_on_bit = weight_on_bit
    state.u_np -= passed
    state.u_fm -= passed
    state.u_dt -= passed
    if grips:
        state.u_fm = min(state.u_fm, 0.0)
        state.u_dt = state.v_dt = 0.0
    if state.resonant:
        resonator.change_drive(state, level, frequency, resonance_frequency)
    else:
        state.target_amplitude = level
        state.frequency = frequency
    if not drill.in_rock:
        state.tool_at_rest = 0
    turn = turn_at(state.phase)
    count, turn = settle(drill, state, impact, impacts, 0, turn, 0, 0, EVENT_COMMAND)
    open_segment(drill, oscillators_of(drill), state, segment, turn)
    return count


@compiled
def start(drill, states, open_segments, open_impacts, impacts):
    """Begin with every gap closed and every body at rest; returns the finished impacts' number."""
    state = states[0]
    if state.resonant:
        resonator.begin_resonance(state)
    turn = turn_at(state.phase)
    state.u_np = -state.amplitude * turn.sine
    count, turn = settle(drill, state, open_impacts[0], impacts, 0, turn, 0, 0, 0)
    open_segment(drill, oscillators_of(drill), state, open_segments[0], turn)
    return count
