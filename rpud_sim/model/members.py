"""Members of an ensemble: runs whose trajectory is added to a tally and not kept."""

import math

from rpud_sim.model.compile import compiled
from rpud_sim.model.energy import add_event, add_motion, add_rest
from rpud_sim.model.events import (
    DONE,
    FULL,
    GOES_ON,
    pass_event,
    start,
    status_before,
)
from rpud_sim.model.guards import END_DRILL_TOOL_RELEASE
from rpud_sim.model.motion import oscillators_of
from rpud_sim.model.segment import Turns, motion_of, turns_at_end
from rpud_sim.model.suspension import NO_SWING
from rpud_sim.model.tally import (
    IMPULSE,
    OFFSET,
    POSITION,
    QUANTILE,
    add_impacts,
    begin_part,
    class_at,
    count_event,
    finish_part,
    reacting_impulse,
)
from rpud_sim.model.vibration import turn_at

# Impacts that one event can end.
_IMPACTS_OF_EVENT = 2

# How an advance of members ends beside those of the engine: with a motion that is not finite.
NOT_FINITE = 10


@compiled
def _advance_member(
    drill,
    rpud,
    state,
    segment,
    impact,
    seconds,
    fraction,
    added,
    whole,
    impacts,
    count,
    tally,
    part,
):
    """Advance a member until its open segment reaches beyond a time, or impacts lack room.

    It does what ``events.advance`` and ``tally.add_block`` do, with the same bits, but keeps no
    segments. So the functions that the engine computes at an event serve the sums as well.

    Args:
        added: whether anything is added.
        whole: whether the account is whole.
        part: sums of the part of the run in progress.

    Returns:
        DONE, FULL, STALLED or OVERLOADED, and the number of finished impacts.
    """
    bodies = oscillators_of(drill)
    turn = turn_at(segment.vibration_phase)
    while True:
        is_full = len(impacts) - count < _IMPACTS_OF_EVENT
        status = status_before(state, segment, seconds, fraction, is_full)
        if status != GOES_ON:
            return status, count
        turns = turns_at_end(segment, state.next_event == END_DRILL_TOOL_RELEASE)
        contact = segment.contact
        end = segment.duration
        ended = motion_of(segment, end, turns)
        offset = part[OFFSET]
        if added and end > offset:
            add_motion(rpud, segment, offset, end, whole, part)
            part[IMPULSE] += reacting_impulse(
                segment, offset, end, part[POSITION], ended[0], turn, turns
            )
        # Called in one place alone, so that it is compiled into the loop.
        count, turn = pass_event(
            drill, bodies, state, segment, segment, impact, impacts, count, turns
        )
        if not added:
            continue
        motion = motion_of(segment, 0.0, Turns(turn, NO_SWING, NO_SWING))
        # Nothing changes the constants of a member.
        mass, spring_rate = segment.drill_tool_mass, segment.drill_tool_spring_rate
        rested = add_rest(contact, mass, spring_rate, segment, ended, part)
        add_event(rpud, rested, motion, segment, part)
        count_event(segment, tally)
        part[OFFSET] = 0.0
        part[POSITION] = motion[0]


@compiled
def _is_finite(state):
    """Whether the numbers are finite that all others of the state follow from."""
    return (
        math.isfinite(state.u_np)
        and math.isfinite(state.v_np)
        and math.isfinite(state.u_fm)
        and math.isfinite(state.v_fm)
        and math.isfinite(state.u_dt)
        and math.isfinite(state.v_dt)
        and math.isfinite(state.amplitude)
        and math.isfinite(state.frequency)
        and math.isfinite(state.owed)
    )


@compiled
def advance_members(
    drill, rpud, members, start_seconds, start_fraction, seconds, fraction, options, room, progress
):
    """Advance members of an ensemble one after another, and add what happens to their tallies.

    Args:
        members: ``STATE``, open ``SEGMENT``, open ``IMPACT``, ``TALLY``, status and class of the 99
            % quantile of each, arrays of shape (members,). The status is that of
            ``events.advance``, or NOT_FINITE.
        options: whether the members begin now, whether they end then, whether anything is added,
            whether the event of the first segment counts, and whether the account is whole. Several
            members must begin and end in one call, as they share the classes.
        room: for impacts, for the classes of contact forces, and for the sums of the part in
            progress.
        progress: member to go on with, how many impacts it has, -1 before it is its turn, and how
            many the last one had.

    Returns:
        Whether all members are there. If not, the room for impacts is too small: call again with
        more, which holds the present ones.
    """
    states, open_segments, open_impacts, tallies, statuses, quantiles = members
    starts, ends, added, counts, whole = options
    impacts, classes, part = room
    while progress[0] < len(states):
        i = progress[0]
        one = states[i : i + 1]
        segment = open_segments[i : i + 1]
        impact = open_impacts[i : i + 1]
        tally = tallies[i]
        if progress[1] < 0:
            progress[1] = 0
            if starts:
                progress[1] = start(drill, one, segment, impact, impacts)
            if added:
                begin_part(rpud, segment[0], start_seconds, start_fraction, counts, tally, part)
        status, progress[1] = _advance_member(
            drill,
            rpud,
            one[0],
            segment[0],
            impact[0],
            seconds,
            fraction,
            added,
            whole,
            impacts,
            progress[1],
            tally,
            part,
        )
        if status == FULL:
            return False
        if status == DONE and not _is_finite(one[0]):
            status = NOT_FINITE
        statuses[i] = status
        if added and status == DONE:
            finish_part(rpud, segment[0], seconds, fraction, whole, tally, part)
            add_impacts(impacts[: progress[1]], tally, classes, part)
        if ends:
            quantiles[i] = class_at(tallies[i : i + 1], classes, QUANTILE)
            if tally.impacts:
                classes[tally.lowest_class : tally.highest_class + 1] = 0
        progress[0] += 1
        progress[2] = progress[1]
        progress[1] = -1
    return True
