"""Tally of a run: sums over its segments and impacts, added in compiled code.

The kernels add up what a trajectory's records say. They add in the same order for a block that
somebody keeps (``add_block``) and for members of an ensemble, whose records nobody keeps
(``advance_members``). All kernels are in this file, so that all are compiled again when it changes.
"""

import math

import numpy as np

from rpud_sim.model.compile import compiled
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
    turns_at_end,
)
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_RELEASE,
    Turns,
    motion_at,
    motion_of,
    nodal_plane_integral_of,
    turns_at,
)
from rpud_sim.model.strike import NO_STRIKE
from rpud_sim.model.suspension import NO_SWING
from rpud_sim.model.vibration import turn_at

# What happened in the parts of a run that were added, and the account of the part in progress.
TALLY = np.dtype(
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
    ],
    align=True,
)

# Contact forces are counted in logarithmic classes; what is beyond the ends counts as these [N].
LEAST_FORCE, GREATEST_FORCE = 1e-6, 1e12
CLASSES_PER_DECADE = 1000
CLASSES = round(math.log10(GREATEST_FORCE / LEAST_FORCE) * CLASSES_PER_DECADE) + 1

QUANTILE = 0.99  # of the contact forces, that is one of the figures

# Impacts that one event can end.
_IMPACTS_OF_EVENT = 2

# Sums of the part of a run in progress: its account, its impulse, and of its first segment that is
# not yet added the time from which on it counts [s], and u_np there [m].
_IMPULSE = len(TERMS)
_OFFSET = _IMPULSE + 1
_POSITION = _IMPULSE + 2
# Room of a pairwise sum: for each of the halves in progress its number of values, the sum of its
# first half, and whether that is known.
_DEPTH = 64
_COUNTS = _IMPULSE + 3
_HALVES = _COUNTS + _DEPTH
_KNOWN = _HALVES + _DEPTH
PART_ROOM = _KNOWN + _DEPTH

_HAPPENED = EVENT_ACTUATOR_IMPACT | EVENT_DRILL_TOOL_IMPACT | EVENT_RELEASE

# How an advance of members ends beside those of the engine: with a motion that is not finite.
NOT_FINITE = 10


def empty_tallies(count: int) -> np.ndarray:
    """Return tallies of nothing, shape (count,)."""
    tallies = np.zeros(count, TALLY)
    tallies["lowest_class"] = CLASSES
    tallies["highest_class"] = -1
    tallies["contact_force_max"] = -math.inf
    return tallies


@compiled
def _reacting_impulse(segment, start, end, u_start, u_end, turn, turns):
    """Integral of R = W - k_1 u_np - c_1 v_np over a part of a segment [N s].

    Args:
        segment: a ``SEGMENT`` record.
        start: of the part, since the segment's start [s].
        end: of the part [s].
        u_start: u_np at its start [m].
        u_end: u_np at its end [m].
        turn: ``Turn`` of the vibration at the segment's start.
        turns: ``Turns`` at the part's end.
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
def _count(segment, tally):
    """Count the event that began a segment."""
    if segment.event & _HAPPENED:
        tally.events += 1
    if segment.event & EVENT_ACTUATOR_IMPACT:
        tally.actuator_impacts += 1


@compiled
def _begin(rpud, segment, seconds, fraction, counts, tally, part):
    """Begin a part of a run within its first segment.

    Args:
        rpud: the ``RpudConstants``.
        segment: in progress at the part's beginning.
        seconds: whole seconds of that time.
        fraction: the rest of it [s].
        counts: whether the segment begins with the part, so that its event counts.
        tally: to add to.
        part: sums of the part, shape (PART_ROOM,).
    """
    part[:_COUNTS] = 0.0
    offset = time_in(segment, seconds, fraction)
    motion = motion_at(segment, offset)
    part[STORED] -= stored_energy(segment, motion, rpud.mass)
    part[_OFFSET] = offset
    part[_POSITION] = motion[0]
    if counts:
        _count(segment, tally)


@compiled
def _add_ended(rpud, covering, last, tally, part):
    """Add the segments before the last one of those that cover a part of a run."""
    offset = part[_OFFSET]
    position = part[_POSITION]
    for i in range(last):
        segment = covering[i]
        after = covering[i + 1]
        ended, motion = add_ended_segment(rpud, segment, after, offset, part)
        end = segment.duration
        if end > offset:
            turn, turns = turn_at(segment.vibration_phase), turns_at(segment, end)
            part[_IMPULSE] += _reacting_impulse(
                segment, offset, end, position, ended[0], turn, turns
            )
        _count(after, tally)
        offset = 0.0
        position = motion[0]
    part[_OFFSET] = offset
    part[_POSITION] = position


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

    It does what ``events.advance`` and ``_add_ended`` do, with the same bits, but keeps no
    segments. So the functions that the engine computes at an event serve the sums as well.

    Args:
        drill: the constants.
        rpud: the ``RpudConstants``.
        state: the moving state.
        segment: the open segment.
        impact: the record in progress.
        seconds: whole seconds of the time.
        fraction: the rest of it [s].
        added: whether anything is added.
        whole: whether the account is whole.
        impacts: room for finished impacts.
        count: how many it holds.
        tally: to add to.
        part: sums of the part of the run in progress.

    Returns:
        DONE, FULL, STALLED or OVERLOADED, and the number of finished impacts.
    """
    strike = NO_STRIKE
    turn = turn_at(segment.vibration_phase)
    while True:
        is_full = len(impacts) - count < _IMPACTS_OF_EVENT
        status = status_before(state, segment, seconds, fraction, is_full)
        if status != GOES_ON:
            return status, count
        turns = turns_at_end(segment, strike)
        contact = segment.contact
        end = segment.duration
        ended = motion_of(segment, end, turns)
        offset = part[_OFFSET]
        if added and end > offset:
            add_motion(rpud, segment, offset, end, whole, part)
            part[_IMPULSE] += _reacting_impulse(
                segment, offset, end, part[_POSITION], ended[0], turn, turns
            )
        # Called in one place alone, so that it is compiled into the loop.
        count, strike, turn = pass_event(drill, state, segment, impact, impacts, count, turns)
        if not added:
            continue
        motion = motion_of(segment, 0.0, Turns(turn, NO_SWING, NO_SWING))
        # Nothing changes the constants of a member.
        mass, spring_rate = segment.drill_tool_mass, segment.drill_tool_spring_rate
        rested = add_rest(contact, mass, spring_rate, segment, ended, part)
        add_event(rpud, rested, motion, segment, part)
        _count(segment, tally)
        part[_OFFSET] = 0.0
        part[_POSITION] = motion[0]


@compiled
def _finish(rpud, segment, seconds, fraction, whole, tally, part):
    """Add the open segment up to the end of a part of a run, and the part to the tally."""
    offset = part[_OFFSET]
    end = time_in(segment, seconds, fraction)
    motion = motion_at(segment, end)
    if end > offset:
        add_motion(rpud, segment, offset, end, whole, part)
        turn, turns = turn_at(segment.vibration_phase), turns_at(segment, end)
        part[_IMPULSE] += _reacting_impulse(
            segment, offset, end, part[_POSITION], motion[0], turn, turns
        )
    part[STORED] += stored_energy(segment, motion, rpud.mass)
    tally.reacting_impulse += part[_IMPULSE]
    account = tally.account
    for i in range(len(TERMS)):
        account[i] += part[i]


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
def pairwise_sum(values, part):
    """Sum of values in the order of ``numpy.sum``, which halves them until 128 are left.

    A plain sum would round differently, and a run's figures would no longer be those of its bag.

    Args:
        values: to add.
        part: room, shape (PART_ROOM,).
    """
    count = len(values)
    first = 0
    depth = 0
    while True:
        while count > 128:
            part[_COUNTS + depth] = count
            part[_KNOWN + depth] = 0.0
            half = count // 2
            count = half - half % 8
            depth += 1
        total = _sum_of_128(values, first, count)
        first += count
        depth -= 1
        while depth >= 0 and part[_KNOWN + depth] != 0.0:
            total = part[_HALVES + depth] + total
            depth -= 1
        if depth < 0:
            return total
        part[_HALVES + depth] = total
        part[_KNOWN + depth] = 1.0
        whole = int(part[_COUNTS + depth])
        half = whole // 2
        count = whole - (half - half % 8)
        depth += 1


@compiled
def class_of(force):
    """Number of a contact force's class [N]."""
    if not force > LEAST_FORCE:
        return 0
    return int(np.rint(math.log10(min(force, GREATEST_FORCE) / LEAST_FORCE) * CLASSES_PER_DECADE))


@compiled
def _add_impacts(impacts, tally, classes, part):
    """Add the impacts of a part of a run.

    Args:
        impacts: all of them, in order.
        tally: to add to.
        classes: of the contact forces: how many are in each, shape (CLASSES,).
        part: room, shape (PART_ROOM,).
    """
    if not len(impacts):
        return
    tally.impacts += len(impacts)
    tally.impact_velocity += pairwise_sum(impacts["impact_velocity"], part)
    tally.contact_force += pairwise_sum(impacts["peak_force"], part)
    tally.contact_duration += pairwise_sum(impacts["contact_duration"], part)
    tally.energy += pairwise_sum(impacts["energy"], part)
    tally.energy_transferred += pairwise_sum(impacts["energy_transferred"], part)
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
        rpud: the ``RpudConstants``.
        covering: ``SEGMENT`` records that cover these times; the last one is open.
        impacts: ``IMPACT`` records.
        start_seconds: whole seconds of the first time.
        start_fraction: the rest of it [s].
        seconds: whole seconds of the second time.
        fraction: the rest of it [s].
        counts: whether the event of the first segment counts.
        tallies: one ``TALLY``.
        classes: of the contact forces, shape (CLASSES,).
        part: room for the block's own sums, shape (PART_ROOM,).
    """
    tally = tallies[0]
    last = len(covering) - 1
    _begin(rpud, covering[0], start_seconds, start_fraction, counts, tally, part)
    _add_ended(rpud, covering, last, tally, part)
    _finish(rpud, covering[last], seconds, fraction, True, tally, part)
    _add_impacts(impacts, tally, classes, part)


@compiled
def class_at(tallies, classes, share):
    """Class of the least force that a share of all do not exceed; -1 without any force.

    Args:
        tallies: one ``TALLY``.
        classes: of its contact forces.
        share: from 0 to 1.
    """
    wanted = math.ceil(share * tallies[0].impacts)
    reached = 0
    for number in range(tallies[0].lowest_class, tallies[0].highest_class + 1):
        reached += classes[number]
        if reached >= wanted:
            return number
    return -1


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
        drill: the constants.
        rpud: the ``RpudConstants``.
        members: ``STATE``, open ``SEGMENT``, open ``IMPACT``, ``TALLY``, status and class of the 99
            % quantile of each, arrays of shape (members,). The status is that of
            ``events.advance``, or NOT_FINITE.
        start_seconds: whole seconds of the time that they have reached.
        start_fraction: the rest of it [s].
        seconds: whole seconds of the time to advance to.
        fraction: the rest of it [s].
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
                _begin(rpud, segment[0], start_seconds, start_fraction, counts, tally, part)
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
            _finish(rpud, segment[0], seconds, fraction, whole, tally, part)
            _add_impacts(impacts[: progress[1]], tally, classes, part)
        if ends:
            quantiles[i] = class_at(tallies[i : i + 1], classes, QUANTILE)
            if tally.impacts:
                classes[tally.lowest_class : tally.highest_class + 1] = 0
        progress[0] += 1
        progress[2] = progress[1]
        progress[1] = -1
    return True
