"""Tally of a run: sums over its segments and impacts, added in compiled code.

The sums are those of a trajectory's records. They are added in the same order for a block whose
records are kept (``add_block``) and for members of an ensemble, which keep none
(``advance_members``).
"""

import math

import numpy as np

from rpud_sim.model.closed_form import NO_SWING, turn_at
from rpud_sim.model.compile import compiled, record_type
from rpud_sim.model.elementary import decimal_logarithm
from rpud_sim.model.energy import (
    STORED,
    TERMS,
    add_ended_segment,
    add_event,
    add_motion,
    add_rest,
    stored_energy,
    time_in,
)
from rpud_sim.model.events import (
    DONE,
    FULL,
    GOES_ON,
    pass_event,
    start,
    status_before,
)
from rpud_sim.model.search import END_DRILL_TOOL_RELEASE
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_RELEASE,
    Turns,
    motion_at,
    motion_of,
    nodal_plane_integral_of,
    oscillators_of,
    turns_at,
    turns_at_end,
)

# Of each of the halves in progress: its number of values, the sum of its first half, and whether
# that is known.
_DEPTH = 64
_HALVES = _DEPTH
_KNOWN = 2 * _DEPTH
# Numbers that a sum needs room for
SUM_ROOM = 3 * _DEPTH


@compiled
def _sum_of_128(values, first, count):
    """Sum of at most 128 values, as NumPy adds them."""
    if count < 8:
        total = -0.0
        for i in range(first, first + count):
            total += values[i]
        return total
    a, b, c, d = values[first], values[first + 1], values[first + 2], values[first + 3]
    e, f, g, h = values[first + 4], values[first + 5], values[first + 6], values[first + 7]
    whole = count - count % 8
    for i in range(first + 8, first + whole, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + count):
        total += values[i]
    return total


@compiled
def pairwise_sum(values, room):
    """Sum of values in the order of ``numpy.sum``, which halves them until 128 are left.

    A plain sum would round differently, and a run's figures would no longer be those of its bag.

    Args:
        room: for what is in progress, shape (SUM_ROOM,).
    """
    count = len(values)
    first = 0
    depth = 0
    while True:
        while count > 128:
            room[depth] = count
            room[_KNOWN + depth] = 0.0
            half = count // 2
            count = half - half % 8
            depth += 1
        total = _sum_of_128(values, first, count)
        first += count
        depth -= 1
        while depth >= 0 and room[_KNOWN + depth] != 0.0:
            total = room[_HALVES + depth] + total
            depth -= 1
        if depth < 0:
            return total + 0.0  # it begins with zero, so that no sum is -0.0
        room[_HALVES + depth] = total
        room[_KNOWN + depth] = 1.0
        whole = int(room[depth])
        half = whole // 2
        count = whole - (half - half % 8)
        depth += 1


# What happened in the parts of a run that were added, and the account of the part in progress.
TALLY = record_type(
    [
        ("events", np.int64),
        ("actuator_impacts", np.int64),
        ("impacts", np.int64),
        ("squeezed", np.int64),
        ("lowest_class", np.int64),  # of the contact forces, see ``add_forces``
        ("highest_class", np.int64),
        ("contact_force_max", np.float64),
        ("impact_velocity", np.float64),
        ("contact_force", np.float64),
        ("contact_duration", np.float64),
        ("energy", np.float64),
        ("energy_transferred", np.float64),
        ("reacting_impulse", np.float64),
        ("account", np.float64, (len(TERMS),)),
    ]
)

# Contact forces are counted in logarithmic classes; what is beyond the ends counts as these [N].
LEAST_FORCE, GREATEST_FORCE = 1e-6, 1e12
CLASSES_PER_DECADE = 1000
CLASSES = 18 * CLASSES_PER_DECADE + 1  # 18 decades

QUANTILE = 0.99  # of the contact forces, that is one of the figures

# Sums of the part of a run in progress: its account, its impulse, and of its first segment that is
# not yet added the time from which on it counts [s], and u_np there [m].
IMPULSE = len(TERMS)
OFFSET = IMPULSE + 1
POSITION = IMPULSE + 2
# Behind them is the room of a pairwise sum.
_SUMS = IMPULSE + 3
PART_ROOM = _SUMS + SUM_ROOM

_HAPPENED = EVENT_ACTUATOR_IMPACT | EVENT_DRILL_TOOL_IMPACT | EVENT_RELEASE


def empty_tallies(count: int) -> np.ndarray:
    """Return tallies of nothing, shape (count,)."""
    tallies = np.zeros(count, TALLY)
    tallies["lowest_class"] = CLASSES
    tallies["highest_class"] = -1
    tallies["contact_force_max"] = -math.inf
    return tallies


@compiled
def reacting_impulse(segment, start, end, u_start, u_end, turn, turns):
    """Integral of R = W - k_1 u_np - c_1 v_np over a part of a segment [N s].

    Args:
        start: of the part, since the segment's start [s].
        end: of the part [s].
    """
    position = nodal_plane_integral_of(segment, end, turn, turns)
    if start > 0.0:
        position -= nodal_plane_integral_of(segment, start, turn, turns_at(segment, start))
    return (
        segment.weight_on_bit * (end - start)
        - segment.load_spring_rate * position
        - segment.load_spring_damping * (u_end - u_start)
    )


@compiled
def count_event(segment, tally):
    """Count the event that began a segment."""
    if segment.event & _HAPPENED:
        tally.events += 1
    if segment.event & EVENT_ACTUATOR_IMPACT:
        tally.actuator_impacts += 1


@compiled
def begin_part(rpud, segment, seconds, fraction, counts, tally, part):
    """Begin a part of a run within its first segment.

    Args:
        counts: whether the segment begins with the part, so that its event counts.
        part: sums of the part, shape (PART_ROOM,).
    """
    part[:_SUMS] = 0.0
    offset = time_in(segment, seconds, fraction)
    motion = motion_at(segment, offset)
    part[STORED] -= stored_energy(segment, motion, rpud.mass)
    part[OFFSET] = offset
    part[POSITION] = motion[0]
    if counts:
        count_event(segment, tally)


@compiled
def _add_ended(rpud, covering, last, tally, part):
    """Add the segments before the last one of those that cover a part of a run."""
    offset = part[OFFSET]
    position = part[POSITION]
    for i in range(last):
        segment = covering[i]
        after = covering[i + 1]
        ended, motion, turns = add_ended_segment(rpud, segment, after, offset, part)
        end = segment.duration
        if end > offset:
            turn = turn_at(segment.vibration_phase)
            part[IMPULSE] += reacting_impulse(segment, offset, end, position, ended[0], turn, turns)
        count_event(after, tally)
        offset = 0.0
        position = motion[0]
    part[OFFSET] = offset
    part[POSITION] = position


@compiled
def finish_part(rpud, segment, seconds, fraction, whole, tally, part):
    """Add the open segment up to the end of a part of a run, and the part to the tally."""
    offset = part[OFFSET]
    end = time_in(segment, seconds, fraction)
    motion = motion_at(segment, end)
    if end > offset:
        add_motion(rpud, segment, offset, end, whole, part)
        turn, turns = turn_at(segment.vibration_phase), turns_at(segment, end)
        part[IMPULSE] += reacting_impulse(
            segment, offset, end, part[POSITION], motion[0], turn, turns
        )
    part[STORED] += stored_energy(segment, motion, rpud.mass)
    tally.reacting_impulse += part[IMPULSE]
    account = tally.account
    for i in range(len(TERMS)):
        account[i] += part[i]


@compiled
def class_of(force):
    """Number of a contact force's class [N]."""
    if not force > LEAST_FORCE:
        return 0
    decades = decimal_logarithm(min(force, GREATEST_FORCE) / LEAST_FORCE)
    return int(np.rint(decades * CLASSES_PER_DECADE))


@compiled
def add_impacts(impacts, tally, classes, part):
    """Add the impacts of a part of a run.

    Args:
        classes: of the contact forces: how many are in each, shape (CLASSES,).
        part: room, shape (PART_ROOM,).
    """
    if not len(impacts):
        return
    room = part[_SUMS:]
    tally.impacts += len(impacts)
    tally.impact_velocity += pairwise_sum(impacts["impact_velocity"], room)
    tally.contact_force += pairwise_sum(impacts["peak_force"], room)
    tally.contact_duration += pairwise_sum(impacts["contact_duration"], room)
    tally.energy += pairwise_sum(impacts["energy"], room)
    tally.energy_transferred += pairwise_sum(impacts["energy_transferred"], room)
    for i in range(len(impacts)):
        force = impacts[i].peak_force
        tally.contact_force_max = max(tally.contact_force_max, force)
        if impacts[i].squeezed:
            tally.squeezed += 1
        number = class_of(force)
        classes[number] += 1
        tally.lowest_class = min(tally.lowest_class, number)
        tally.highest_class = max(tally.highest_class, number)


@compiled
def add_block(
    rpud,
    covering,
    impacts,
    start_seconds,
    start_fraction,
    seconds,
    fraction,
    counts,
    tallies,
    classes,
    part,
):
    """Add what happened between two times to a tally.

    Args:
        covering: ``SEGMENT`` records that cover these times; the last one is open.
        counts: whether the event of the first segment counts.
        classes: of the contact forces, shape (CLASSES,).
        part: room for the block's own sums, shape (PART_ROOM,).
    """
    tally = tallies[0]
    last = len(covering) - 1
    begin_part(rpud, covering[0], start_seconds, start_fraction, counts, tally, part)
    _add_ended(rpud, covering, last, tally, part)
    finish_part(rpud, covering[last], seconds, fraction, True, tally, part)
    add_impacts(impacts, tally, classes, part)


@compiled
def class_at(tallies, classes, share):
    """Class of the least force that a share of all do not exceed; -1 without any force."""
    wanted = math.ceil(share * tallies[0].impacts)
    reached = 0
    for number in range(tallies[0].lowest_class, tallies[0].highest_class + 1):
        reached += classes[number]
        if reached >= wanted:
            return number
    return -1


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
