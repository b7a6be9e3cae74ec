"""Yielding: how a resonant vibration moves while the tip presses free mass and tool on the rock.

Elsewhere contacts are short beside a cycle, and the vibration continues. Between tip and rock it
yields: with the modal mass M, its stiffness k_q = M Omega^2, the force F of drive and losses, and
the contact's N,

    M q'' + k_q q = F - N        N = m (u_np + q)'' + c (u_np + q)' + k (u_np + q) - m_fm g

q is -r times the slow part of u_np, r = k / (k_q + k), a static part, and a vibration at the rate
of M + m on k_q + k. For this q the motion of the bodies is exact. F is constant in a segment, which
lasts an eighth of a cycle at most; what this leaves of energy is ``pending``, as everywhere.
"""

import math
from typing import NamedTuple

from rpud_sim.model.closed_form import (
    NO_SWING,
    TWO_PI,
    Oscillation,
    decaying_derivatives,
    free_vibration,
    oscillator,
    swinging_part,
)
from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import arc_tangent, hypotenuse, sin_cos, sin_cos_cycles

# In a segment the vibration continues, carries the free mass, or yields between tip and rock.
YIELDS_NOT, YIELDS_TO_MASS, YIELDS_TO_ROCK = 0, 1, 2

# Longest segment of it, and of a small vibration elsewhere, in cycles of the drive.
STEP = 0.125
FREE_STEP = 0.0625


class Yielding(NamedTuple):
    """Motion while the vibration yields."""

    nodal_plane: Oscillation
    added: Oscillation  # motion of the tip beyond nodal plane and vibration
    amplitude: float  # amplitude of the vibration [m]
    frequency: float  # [Hz]
    phase: float  # [cycles]


@compiled
def yields(state):
    """Whether the vibration yields where tip and tool hold the free mass between them."""
    moved = state.amplitude_per_volt * state.voltage > 0.0
    return state.resonant and (state.amplitude > 0.0 or moved)


@compiled
def stiffness_of(state):
    """k_q = M Omega^2 [N/m], with which the vibration is stiff at the tip."""
    scale = state.amplitude_per_volt
    return state.decay_time / (2.0 * state.resistance * scale * scale)


@compiled
def drive_force(state):
    """Amplitude of the drive's force on the vibration [N]."""
    velocity = TWO_PI * state.resonance_frequency * state.amplitude_per_volt * state.voltage
    return 2.0 * state.modal_mass * velocity / state.decay_time


@compiled
def forces_on(state, velocity):
    """Mean forces of drive and losses on the vibration in the step to come [N]."""
    begin, _ = sin_cos_cycles(state.drive_phase)
    end, _ = sin_cos_cycles(state.drive_phase + STEP)
    mean = (end - begin) / (TWO_PI * STEP)
    return drive_force(state) * mean, -2.0 * state.modal_mass / state.decay_time * velocity


@compiled
def impulses_on(state, time, travel):
    """Impulses of drive and losses on the vibration in a time before this, over a travel [m].

    The drive moves the vibration, too. This displacement, which the tip cannot make immediately, is
    ``missing``, and turns with the vibration into impulses.
    """
    omega = TWO_PI * state.resonance_frequency
    turned = state.drive_frequency * time
    _, begin = sin_cos_cycles(state.drive_phase)
    _, middle = sin_cos_cycles(state.drive_phase + 0.5 * turned)
    _, end = sin_cos_cycles(state.drive_phase + turned)
    half_sine, half_cosine = sin_cos(0.5 * omega * time)
    sine = 2.0 * half_sine * half_cosine
    cosine = 1.0 - 2.0 * half_sine * half_sine
    share = drive_force(state) * time / 6.0  # by Simpson's rule
    impulse = share * (begin * cosine + 4.0 * middle * half_cosine + end)
    moved = share * (begin * sine + 4.0 * middle * half_sine) / (omega * state.modal_mass)
    impulse -= state.modal_mass * omega * state.missing * sine
    state.missing = state.missing * cosine + moved
    return impulse, -2.0 * state.modal_mass / state.decay_time * travel


@compiled
def yielding_motion(drill, state, turn, v_np):
    """Return the ``Yielding`` from a state on, at a velocity of the nodal plane.

    The state gets the forces of drive and losses.
    """
    omega = TWO_PI * state.frequency
    state.drive_force, state.loss_force = forces_on(state, omega * state.amplitude * turn.cosine)
    force = state.weight_on_bit + drill.rpud_weight + drill.free_mass * drill.gravity
    stiffness = stiffness_of(state)
    mass, damping = drill.free_mass + drill.tool_mass, drill.tool_damping
    spring_rate = drill.tool_spring_rate
    whole = stiffness + spring_rate
    square = whole / (state.modal_mass + mass)
    rate = math.sqrt(square)
    ratio = spring_rate / whole
    left = 1.0 - ratio
    still = (drill.free_mass * drill.gravity + state.drive_force + state.loss_force) / whole
    # What a vibration of the tip makes of the nodal plane, in phase and across.
    bending = drill.load_spring_rate + spring_rate - (drill.rpud_mass + mass) * square
    resistance = (drill.rpud_damping + damping) * rate
    size = bending * bending + resistance * resistance
    pull, drag = mass * square - spring_rate, -damping * rate
    along = (bending * pull + resistance * drag) / size
    across = (bending * drag - resistance * pull) / size
    first = state.amplitude * turn.sine + ratio * state.u_np - still
    second = (omega * state.amplitude * turn.cosine + ratio * v_np) / rate
    near, far = 1.0 + ratio * along, ratio * across
    size = near * near + far * far
    sine = (near * first - far * second) / size
    cosine = (near * second + far * first) / size
    body = oscillator(
        drill.rpud_mass + left * mass,
        drill.rpud_damping + left * damping,
        drill.load_spring_rate + left * spring_rate,
    )
    slow = free_vibration(
        body,
        force - spring_rate * still,
        state.u_np - along * sine - across * cosine,
        v_np - rate * (along * cosine - across * sine),
    )
    amplitude = hypotenuse(sine, cosine)
    phase = arc_tangent(sine, cosine) / TWO_PI if amplitude > 0.0 else 0.0
    offset, a, w, A_1, A_2, _, _ = slow
    return Yielding(
        Oscillation(offset, a, w, A_1, A_2, along * amplitude, across * amplitude),
        Oscillation(still - ratio * offset, a, w, -ratio * A_1, -ratio * A_2, 0.0, 0.0),
        amplitude,
        rate / TWO_PI,
        phase - math.floor(phase),
    )


@compiled
def yielding_acceleration(drill, state, turn, v_np):
    """Acceleration of the tip at the start of a ``Yielding`` [m/s^2]."""
    moves = yielding_motion(drill, state, turn, v_np)
    sine, cosine = sin_cos_cycles(moves.phase)
    rate = TWO_PI * moves.frequency
    motion = moves.nodal_plane
    vibration = (motion.vibration_sine + moves.amplitude) * sine + motion.vibration_cosine * cosine
    total = Oscillation(
        0.0,
        motion.decay_rate,
        motion.angular_frequency,
        motion.cosine + moves.added.cosine,
        motion.sine + moves.added.sine,
        0.0,
        0.0,
    )
    displacement, velocity = swinging_part(total, NO_SWING)
    acceleration, _ = decaying_derivatives(total, displacement, velocity)
    return acceleration - rate * rate * vibration


@compiled
def carrying_frequency(drill, state):
    """Frequency of the vibration while the tip carries the free mass [Hz]."""
    return state.frequency / math.sqrt(1.0 + drill.free_mass / state.modal_mass)


@compiled
def carrying_vibration(drill, state, turn):
    """Return the same frequency, and amplitude [m] and phase [cycles] of the same motion."""
    frequency = carrying_frequency(drill, state)
    along = state.amplitude * turn.sine
    across = state.amplitude * turn.cosine * (state.frequency / frequency)
    phase = arc_tangent(along, across) / TWO_PI
    return frequency, hypotenuse(along, across), phase - math.floor(phase)
