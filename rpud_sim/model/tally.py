"""Tally of a run: sums over its segments and impacts, added in compiled code.

The sums are those of a trajectory's records. They are added in the same order for a block whose
records are kept (``add_block``) and for members of an ensemble, which keep none (``members.py``).
"""

import math

import numpy as np

from rpud_sim.model.compile import compiled, record_type
from rpud_sim.model.elementary import decimal_logarithm
from rpud_sim.model.energy import (
    STORED,
    TERMS,
    add_ended_segment,
    add_motion,
    stored_energy,
    time_in,
)
from rpud_sim.model.pairwise_sum import SUM_ROOM, pairwise_sum
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_RELEASE,
    motion_at,
    nodal_plane_integral_of,
    turns_at,
)
from rpud_sim.model.vibration import turn_at

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
