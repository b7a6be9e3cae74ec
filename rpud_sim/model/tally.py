"""Tally of a run: sums over its segments and impacts, added in compiled code."""

import math

import numpy as np

from rpud_sim.model import energy
from rpud_sim.model.closed_form import NO_SWING, turn_at
from rpud_sim.model.compile import compiled, floats, record_type
from rpud_sim.model.elementary import decimal_logarithm
from rpud_sim.model.segment import (
    EVENT_ACTUATOR_IMPACT,
    EVENT_DRILL_TOOL_IMPACT,
    EVENT_RELEASE,
    Turns,
    motion_at,
    motion_of,
    nodal_plane_integral,
    turns_at,
    turns_at_end,
)

# What happened in the parts of a run that were added, and the account of the part in progress.
TALLY = record_type(
    [
        *((name, np.int64) for name in ("events", "actuator_impacts", "impacts", "squeezed")),
        ("lowest_class", np.int64),  # lowest class of the contact forces, see ``add_impacts``
        ("highest_class", np.int64),
        *floats("contact_force_max", "impact_velocity", "contact_force", "contact_duration"),
        *floats("energy", "energy_transferred", "reacting_impulse"),
        ("account", np.float64, (len(energy.TERMS),)),
    ]
)

# Contact forces are counted in logarithmic classes; what is beyond the ends counts as these [N].
LEAST_FORCE, GREATEST_FORCE = 1e-6, 1e12
CLASSES_PER_DECADE = 1000
CLASSES = 18 * CLASSES_PER_DECADE + 1  # 18 decades

QUANTILE = 0.99  # quantile of the contact forces, one of the metrics

# Sums of the part of a run in progress: its account, its impulse, and of its first segment that is
# not yet added the time from which on it counts [s], and u_np there [m].
IMPULSE = len(energy.TERMS)
OFFSET = IMPULSE + 1
POSITION = IMPULSE + 2
PART_ROOM = IMPULSE + 3

_HAPPENED = EVENT_ACTUATOR_IMPACT | EVENT_DRILL_TOOL_IMPACT | EVENT_RELEASE


def empty_tallies(count: int) -> np.ndarray:
    tallies = np.zeros(count, TALLY)
    tallies["lowest_class"] = CLASSES
    tallies["highest_class"] = -1
    tallies["contact_force_max"] = -math.inf
    return tallies


@compiled
def time_in(segment, seconds, fraction):
    """Time from a segment's start to a time, at least zero and at most its duration [s]."""
    time = float(seconds - segment.start_seconds) + (fraction - segment.start_fraction)
    return min(max(time, 0.0), segment.duration)


@compiled
def add_until(rpud, segment, end, motion, turn, ended, part):
    """Add a segment from the part's offset to a time, given motion and ``Turns`` there."""
    start = part[OFFSET]
    if not end > start:
        return
    # The integral of R = W - k_1 u_np - c_1 v_np.
    position = nodal_plane_integral(segment, end, turn, ended)
    begun = Turns(turn, NO_SWING, NO_SWING)
    if start > 0.0:
        begun = turns_at(segment, start)
        position -= nodal_plane_integral(segment, start, turn, begun)
    energy.add_motion(rpud, segment, start, end, begun, ended, part)
    part[IMPULSE] += (
        segment.weight_on_bit * (end - start)
        - segment.load_spring_rate * position
        - segment.load_spring_damping * (motion[0] - part[POSITION])
    )


@compiled
def count_event(segment, tally):
    if segment.event & _HAPPENED:
        tally.events += 1
    if segment.event & EVENT_ACTUATOR_IMPACT:
        tally.actuator_impacts += 1


@compiled
def begin_part(rpud, segment, seconds, fraction, counts, tally, part):
    """Begin a part of a run within its first segment, whose event may count."""
    part[:] = 0.0
    offset = time_in(segment, seconds, fraction)
    motion = motion_at(segment, offset)
    part[energy.STORED] -= energy.stored_energy(segment, motion, rpud.mass)
    part[OFFSET] = offset
    part[POSITION] = motion[0]
    if counts:
        count_event(segment, tally)


@compiled
def add_ended(rpud, segment, after, turn, turns, turn_after, tally, part):
    """Add a segment from the part's offset on, and the event that ends it.

    ``turn`` is at its start, ``turns`` at its end, and ``turn_after`` at the start of the one
    after.
    """
    end = segment.duration
    ended = motion_of(segment, end, turns)
    add_until(rpud, segment, end, ended, turn, turns, part)
    motion = motion_of(after, 0.0, Turns(turn_after, NO_SWING, NO_SWING))
    changed = energy.add_change(segment, after, ended, motion, part)
    rested = energy.add_rest(segment, after, changed, part)
    energy.add_event(rpud, rested, motion, after, part)
    count_event(after, tally)
    part[OFFSET] = 0.0
    part[POSITION] = motion[0]


@compiled
def finish_part(rpud, segment, seconds, fraction, tally, part):
    """Add the open segment up to the end of a part of a run, and the part to the tally."""
    end = time_in(segment, seconds, fraction)
    turns = turns_at(segment, end)
    motion = motion_of(segment, end, turns)
    turn = turn_at(segment.vibration_phase)
    add_until(rpud, segment, end, motion, turn, turns, part)
    part[energy.STORED] += energy.stored_energy(segment, motion, rpud.mass)
    tally.reacting_impulse += part[IMPULSE]
    for i in range(len(energy.TERMS)):
        tally.account[i] += part[i]


@compiled
def add_impacts(impacts, tally, classes):
    """Add the impacts of a part of a run, and count their forces in classes, shape (CLASSES,).

    They are added one after the other: parts give the sums of the whole.
    """
    tally.impacts += len(impacts)
    for i in range(len(impacts)):
        impact = impacts[i]
        force = impact.peak_force
        tally.impact_velocity += impact.impact_velocity
        tally.contact_force += force
        tally.contact_duration += impact.contact_duration
        tally.energy += impact.energy
        tally.energy_transferred += impact.energy_transferred
        tally.contact_force_max = max(tally.contact_force_max, force)
        if impact.squeezed:
            tally.squeezed += 1
        number = 0
        if force > LEAST_FORCE:
            decades = decimal_logarithm(min(force, GREATEST_FORCE) / LEAST_FORCE)
            number = int(np.rint(decades * CLASSES_PER_DECADE))
        classes[number] += 1
        tally.lowest_class = min(tally.lowest_class, number)
        tally.highest_class = max(tally.highest_class, number)


@compiled
def add_block(rpud, covering, impacts, begin, until, counts, tallies, classes, part):
    """Add what happened between two times, whole seconds and fraction each, to a tally.

    ``covering`` are the segments of these times, the last one open; ``counts``: whether the event
    of the first counts. ``classes`` count contact forces, ``part`` is space for the block's own
    sums.
    """
    tally = tallies[0]
    last = len(covering) - 1
    begin_part(rpud, covering[0], begin[0], begin[1], counts, tally, part)
    turn = turn_at(covering[0].vibration_phase)
    for i in range(last):
        segment = covering[i]
        after = covering[i + 1]
        turn_after = turn_at(after.vibration_phase)
        turns = turns_at_end(segment, after.event & EVENT_RELEASE != 0)
        add_ended(rpud, segment, after, turn, turns, turn_after, tally, part)
        turn = turn_after
    finish_part(rpud, covering[last], until[0], until[1], tally, part)
    add_impacts(impacts, tally, classes)


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
