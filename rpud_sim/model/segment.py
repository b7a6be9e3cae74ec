"""Records of a trajectory: segments of closed-form motion, and impacts on the drill tool.

A segment holds all that gives motions and forces from its start to its end, with the constants of
the drill, which may differ in the next one.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.model.closed_form import (
    TWO_PI,
    DecayingSinCos,
    Oscillation,
    Oscillator,
    PhaseSinCos,
    driven_vibration,
    free_vibration,
    oscillator,
    swing_at,
    swinging_part,
    swung_integral,
    turn_at,
)
from rpud_sim.model.compile import compiled, floats, record_type
from rpud_sim.model.contact import release_turn
from rpud_sim.model.yielding import (
    YIELDS_NOT,
    YIELDS_TO_MASS,
    YIELDS_TO_ROCK,
    carrying_vibration,
    yielding_motion,
    yields,
)

# Bodies in contact with the free mass during a segment: bits, both may be set.
CONTACT_ACTUATOR, CONTACT_DRILL_TOOL, CONTACT_BOTH = 1, 2, 3

# What began a segment: bits.
EVENT_ACTUATOR_IMPACT, EVENT_DRILL_TOOL_IMPACT = 1, 2
EVENT_RELEASE, EVENT_COMMAND, EVENT_LIMIT = 4, 8, 16

# Constants of the drill during a segment.
CONSTANTS = (
    *("load_spring_rate", "load_spring_damping", "free_mass", "drill_tool_mass"),
    *("drill_tool_spring_rate", "drill_tool_damping", "gravity"),
)

_OSCILLATION = ("offset", "decay_rate", "angular_frequency", "cosine", "sine")

# Times are whole seconds and a fraction from 0 to 1, so that they keep their precision in long
# runs. Lengths in m, rates in 1/s, phases in cycles; the field names are as in
# rpud_msgs/Trajectory.
SEGMENT = record_type(
    [
        ("start_seconds", np.int64),
        *floats("start_fraction", "duration"),
        ("contact", np.uint8),
        ("event", np.uint8),
        *floats("vibration_phase", "vibration_frequency", "vibration_amplitude", "weight_on_bit"),
        *floats(*(f"nodal_plane_{name}" for name in _OSCILLATION)),
        *floats("nodal_plane_vibration_sine", "nodal_plane_vibration_cosine"),
        *floats("free_mass_position", "free_mass_velocity", "free_mass_acceleration"),
        *floats(*(f"drill_tool_{name}" for name in _OSCILLATION)),
        *floats(*CONSTANTS),
    ]
)

IMPACT = record_type(
    [
        ("sequence", np.uint64),
        ("seconds", np.int64),
        *floats("fraction", "peak_force", "contact_duration", "impact_velocity", "impulse"),
        *floats("energy", "energy_transferred"),
        ("squeezed", np.bool_),
    ]
)


def join_records(records: Sequence[np.ndarray], dtype: np.dtype) -> np.ndarray:
    """Return arrays of records as one array, immutable: kernels are compiled again for others.

    It joins bytes, because NumPy joins structures slowly.
    """
    buffers: Any = records  # NumPy declares no buffers before Python 3.12
    return np.frombuffer(b"".join(buffers), dtype)


@compiled
def nodal_plane_motion(segment):
    return Oscillation(
        segment.nodal_plane_offset,
        segment.nodal_plane_decay_rate,
        segment.nodal_plane_angular_frequency,
        segment.nodal_plane_cosine,
        segment.nodal_plane_sine,
        segment.nodal_plane_vibration_sine,
        segment.nodal_plane_vibration_cosine,
    )


@compiled
def drill_tool_motion(segment):
    return Oscillation(
        segment.drill_tool_offset,
        segment.drill_tool_decay_rate,
        segment.drill_tool_angular_frequency,
        segment.drill_tool_cosine,
        segment.drill_tool_sine,
        0.0,
        0.0,
    )


@compiled
def slow_tip_motion(segment):
    """``Oscillation`` of the tip without the steady vibration, which stays the nodal plane's."""
    motion = nodal_plane_motion(segment)
    if segment.contact != CONTACT_BOTH:
        return motion
    offset, a, w, cosine, sine, along, across = motion
    return Oscillation(
        offset + segment.drill_tool_offset,
        a,
        w,
        cosine + segment.drill_tool_cosine,
        sine + segment.drill_tool_sine,
        along,
        across,
    )


@compiled
def fall(position, velocity, gravity, time):
    """Position [m] and velocity [m/s] of the free mass in free motion, eqs. (10), (17) and (19)."""
    u_fm = position + velocity * time + 0.5 * gravity * time * time
    v_fm = velocity + gravity * time
    return u_fm, v_fm


class Turns(NamedTuple):
    """Trigonometric functions that the motions of a segment need at one time."""

    vibration: PhaseSinCos
    nodal_plane: DecayingSinCos
    drill_tool: DecayingSinCos


@compiled
def vibration_turn(segment, time):
    return turn_at(segment.vibration_phase + segment.vibration_frequency * time)


@compiled
def nodal_plane_swing(segment, time):
    return swing_at(segment.nodal_plane_decay_rate, segment.nodal_plane_angular_frequency, time)


@compiled
def drill_tool_swing(segment, time):
    return swing_at(segment.drill_tool_decay_rate, segment.drill_tool_angular_frequency, time)


@compiled
def turns_at(segment, time):
    return Turns(
        vibration_turn(segment, time),
        nodal_plane_swing(segment, time),
        drill_tool_swing(segment, time),
    )


@compiled
def turns_at_end(segment, is_released):
    """Return the ``Turns`` at a segment's end, where a contact may end for want of force."""
    time = segment.duration
    undamped = segment.contact == CONTACT_DRILL_TOOL and segment.drill_tool_decay_rate == 0.0
    if is_released and undamped and time > 0.0:
        cosine, sine = release_turn(
            segment.drill_tool_cosine,
            segment.drill_tool_sine,
            segment.drill_tool_angular_frequency,
            segment.gravity,
        )
        tool = DecayingSinCos(cosine, sine, cosine - 1.0)
    else:
        tool = drill_tool_swing(segment, time)
    return Turns(vibration_turn(segment, time), nodal_plane_swing(segment, time), tool)


@compiled
def tip_motion(segment, vibration, swing):
    """Motion of nodal plane and tip: u_np, v_np, u_ut, v_ut [m, m/s]."""
    omega = TWO_PI * segment.vibration_frequency
    sine, cosine = vibration
    displacement, velocity = swinging_part(nodal_plane_motion(segment), swing)
    steady_sine = segment.nodal_plane_vibration_sine
    steady_cosine = segment.nodal_plane_vibration_cosine
    u_np = segment.nodal_plane_offset + displacement + steady_sine * sine + steady_cosine * cosine
    v_np = velocity + omega * (steady_sine * cosine - steady_cosine * sine)
    u_ut = u_np + segment.vibration_amplitude * sine
    v_ut = v_np + omega * segment.vibration_amplitude * cosine
    if segment.contact == CONTACT_BOTH:
        # The vibration may yield, at the rates of the nodal plane.
        added, rate = swinging_part(drill_tool_motion(segment), swing)
        u_ut += segment.drill_tool_offset + added
        v_ut += rate
    return u_np, v_np, u_ut, v_ut


@compiled
def motion_at(segment, time):
    """Motion at a time: u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt [m, m/s]."""
    return motion_of(segment, time, turns_at(segment, time))


@compiled
def motion_of(segment, time, turns):
    """Return the same as ``motion_at``, given the ``Turns`` at the time."""
    u_np, v_np, u_ut, v_ut = tip_motion(segment, turns.vibration, turns.nodal_plane)
    if segment.contact == CONTACT_BOTH:
        return u_np, v_np, u_ut, v_ut, u_ut, v_ut, u_ut, v_ut
    displacement, v_dt = swinging_part(drill_tool_motion(segment), turns.drill_tool)
    u_dt = segment.drill_tool_offset + displacement
    if segment.contact == CONTACT_ACTUATOR:
        return u_np, v_np, u_ut, v_ut, u_ut, v_ut, u_dt, v_dt
    if segment.contact == CONTACT_DRILL_TOOL:
        return u_np, v_np, u_ut, v_ut, u_dt, v_dt, u_dt, v_dt
    u_fm, v_fm = fall(
        segment.free_mass_position, segment.free_mass_velocity, segment.free_mass_acceleration, time
    )
    return u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt


@compiled
def nodal_plane_integral(segment, time, start, turns):
    """Integral of u_np over a segment's first part [m s]; ``start`` is the turn at its start."""
    motion = nodal_plane_motion(segment)
    omega = TWO_PI * segment.vibration_frequency
    end = turns.vibration
    steady = motion.vibration_sine * (start.cosine - end.cosine) + (
        motion.vibration_cosine * (end.sine - start.sine)
    )
    swung = swung_integral(motion, turns.nodal_plane)
    return motion.offset * time + swung + steady / omega


class Oscillators(NamedTuple):
    """The bodies that no vibration drives, each an ``Oscillator``."""

    nodal_plane: Oscillator  # the RPUD on its load spring
    tool: Oscillator
    pair: Oscillator  # tool and free mass as one body


@compiled
def oscillators_of(drill):
    damping, spring_rate = drill.tool_damping, drill.tool_spring_rate
    return Oscillators(
        oscillator(drill.rpud_mass, drill.rpud_damping, drill.load_spring_rate),
        oscillator(drill.tool_mass, damping, spring_rate),
        oscillator(drill.free_mass + drill.tool_mass, damping, spring_rate),
    )


@compiled
def nodal_plane_closed_form(drill, bodies, state, amplitude, frequency, turn):
    """Return the ``Oscillation`` of the nodal plane.

    It obeys eq. (2) with the preload W, and its weight if gravity acts on it. Free mass and drill
    tool that it holds against the vibrating tip add inertia and spring, moved by u_hv of eq. (1).
    """
    force = state.weight_on_bit + drill.rpud_weight
    if not state.contact & CONTACT_ACTUATOR:
        return free_vibration(bodies.nodal_plane, force, state.u_np, state.v_np)
    carried, damping, spring_rate = drill.free_mass, 0.0, 0.0
    if state.contact == CONTACT_BOTH:
        carried += drill.tool_mass
        damping, spring_rate = drill.tool_damping, drill.tool_spring_rate
    omega = TWO_PI * frequency
    mass, total_damping = drill.rpud_mass + carried, drill.rpud_damping + damping
    body = oscillator(mass, total_damping, drill.load_spring_rate + spring_rate)
    force += drill.free_mass * drill.gravity
    in_phase = (carried * omega * omega - spring_rate) * amplitude
    across = -damping * omega * amplitude
    return driven_vibration(body, force, in_phase, across, frequency, turn, state.u_np, state.v_np)


@compiled
def drill_tool_closed_form(drill, bodies, state):
    """Return the drill tool's: alone by eq. (14), with the free mass by eq. (31)."""
    if state.contact == CONTACT_DRILL_TOOL:
        force = drill.free_mass * drill.gravity
        return free_vibration(bodies.pair, force, state.u_dt, state.v_dt)
    if state.tool_at_rest or state.contact == CONTACT_BOTH:
        return Oscillation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return free_vibration(bodies.tool, 0.0, state.u_dt, state.v_dt)


@compiled
def begin_segment(drill, bodies, state, segment, turn):
    """Write the closed form that follows from the state into a segment, all but its duration."""
    phase, frequency, amplitude = state.phase, state.frequency, state.amplitude
    state.yields = YIELDS_NOT
    if state.contact == CONTACT_BOTH and yields(state):
        state.yields = YIELDS_TO_ROCK
        motion, tool, amplitude, frequency, phase = yielding_motion(drill, state, turn, state.v_np)
    else:
        if state.contact == CONTACT_ACTUATOR and state.resonant and amplitude > 0.0:
            state.yields = YIELDS_TO_MASS
            frequency, amplitude, phase = carrying_vibration(drill, state, turn)
            turn = turn_at(phase)
        motion = nodal_plane_closed_form(drill, bodies, state, amplitude, frequency, turn)
        tool = drill_tool_closed_form(drill, bodies, state)
    segment.start_seconds = state.seconds
    segment.start_fraction = state.fraction
    segment.contact = state.contact
    segment.event = state.event
    segment.vibration_phase = phase
    segment.vibration_frequency = frequency
    segment.vibration_amplitude = amplitude
    segment.weight_on_bit = state.weight_on_bit
    segment.nodal_plane_offset = motion.offset
    segment.nodal_plane_decay_rate = motion.decay_rate
    segment.nodal_plane_angular_frequency = motion.angular_frequency
    segment.nodal_plane_cosine = motion.cosine
    segment.nodal_plane_sine = motion.sine
    segment.nodal_plane_vibration_sine = motion.vibration_sine
    segment.nodal_plane_vibration_cosine = motion.vibration_cosine
    segment.drill_tool_offset = tool.offset
    segment.drill_tool_decay_rate = tool.decay_rate
    segment.drill_tool_angular_frequency = tool.angular_frequency
    segment.drill_tool_cosine = tool.cosine
    segment.drill_tool_sine = tool.sine
    segment.free_mass_position = state.u_fm
    segment.free_mass_velocity = state.v_fm
    segment.free_mass_acceleration = drill.gravity
    segment.load_spring_rate = drill.load_spring_rate
    segment.load_spring_damping = drill.rpud_damping
    segment.free_mass = drill.free_mass
    segment.drill_tool_mass = drill.tool_mass
    segment.drill_tool_spring_rate = drill.tool_spring_rate
    segment.drill_tool_damping = drill.tool_damping
    segment.gravity = drill.gravity


class Load(NamedTuple):
    """Load that the tip moves through a contact, and the constant force on it."""

    mass: float
    damping: float
    spring_rate: float
    force: float


@compiled
def load_of(segment, with_free_mass):
    mass = damping = spring_rate = force = 0.0
    if with_free_mass:
        mass += segment.free_mass
        force = segment.free_mass * segment.gravity
    if segment.contact == CONTACT_BOTH:
        mass += segment.drill_tool_mass
        damping = segment.drill_tool_damping
        spring_rate = segment.drill_tool_spring_rate
    return Load(mass, damping, spring_rate, force)
