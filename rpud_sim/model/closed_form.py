"""Closed forms of the harmonic vibration, eqs. (1) and (3), and of bodies on springs.

Every suspended body obeys m x'' + c x' + k x = F + H_s sin(phi) + H_c cos(phi), phi = 2 pi f t, as
in eqs. (2), (8), (9) and (14)-(16). H = 0, unless the free mass is held against the vibrating tip.
"""

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import (
    exponential,
    growth_near,
    sin_cos,
    sin_cos_cycles,
    sine_and_less,
)

TWO_PI = 2.0 * math.pi


class PhaseSinCos(NamedTuple):
    """Sine and cosine of the phase angle: computed once for all that is wanted at one instant."""

    sine: float
    cosine: float


@compiled
def turn_at(phase):
    sine, cosine = sin_cos_cycles(phase)
    return PhaseSinCos(sine, cosine)


@compiled
def vibration_of(amplitude, frequency, turn):
    """Displacement and velocity of the harmonic vibration, eq. (1), given its ``PhaseSinCos``."""
    return amplitude * turn.sine, TWO_PI * frequency * amplitude * turn.cosine


@compiled
def advance_phase(phase, frequency, duration):
    """Phase after a duration [s], from 0 to 1 [cycles]."""
    advanced = phase + frequency * duration
    return advanced - math.floor(advanced)


@compiled
def time_to_zero_displacement(phase, frequency):
    """Time until the vibration is next zero, where its amplitude may change [s]; never zero."""
    half_cycles = 2.0 * phase
    return 0.5 * (math.floor(half_cycles) + 1.0 - half_cycles) / frequency


class Oscillator(NamedTuple):
    """A body on a spring, with the rates of its free vibration."""

    mass: float
    damping: float  # c [N s/m], less than critical
    spring_rate: float  # k [N/m]
    decay_rate: float  # a = xi omega_n [1/s]
    angular_frequency: float  # omega_d = omega_n sqrt(1 - xi^2) [rad/s]
    compliance: float  # 1 / k [m/N]
    radian: float  # 1 / omega_d [s]


class Oscillation(NamedTuple):
    """Closed form of a suspended body from the start of a segment.

    x(s) = offset + exp(-decay_rate s) (cosine cos(w s) + sine sin(w s))
           + vibration_sine sin(phi(s)) + vibration_cosine cos(phi(s)),  w = angular_frequency
    """

    offset: float  # [m]
    decay_rate: float  # a = xi omega_n [1/s]
    angular_frequency: float  # omega_d = omega_n sqrt(1 - xi^2) [rad/s]
    cosine: float  # A_1 of eq. (9) [m]
    sine: float  # A_2 of eq. (9) [m]
    vibration_sine: float  # [m]
    vibration_cosine: float  # [m]


def damping_coefficient(damping_ratio, mass, spring_rate):
    """c = 2 xi omega_n m [N s/m], from the text after eqs. (2) and (14)."""
    return 2.0 * damping_ratio * math.sqrt(spring_rate / mass) * mass


@compiled
def oscillator(mass, damping, spring_rate):
    a = 0.5 * damping / mass
    w = math.sqrt(spring_rate / mass - a * a)
    return Oscillator(mass, damping, spring_rate, a, w, 1.0 / spring_rate, 1.0 / w)


@compiled
def free_vibration(body, force, position, velocity):
    """Closed form of an ``Oscillator`` under a constant force, eqs. (8)-(9) and (15)-(16)."""
    a = body.decay_rate
    w = body.angular_frequency
    offset = force * body.compliance
    A_1 = position - offset
    A_2 = (velocity + a * A_1) * body.radian
    return Oscillation(offset, a, w, A_1, A_2, 0.0, 0.0)


@compiled
def driven_vibration(body, force, force_sine, force_cosine, frequency, turn, position, velocity):
    """Closed form of an ``Oscillator`` that also feels the vibration, by the forces H_s and H_c."""
    omega = TWO_PI * frequency
    stiffness = body.spring_rate - body.mass * omega * omega
    resistance = body.damping * omega
    square = stiffness * stiffness + resistance * resistance
    vibration_sine = (stiffness * force_sine + resistance * force_cosine) / square
    vibration_cosine = (stiffness * force_cosine - resistance * force_sine) / square
    steady = vibration_sine * turn.sine + vibration_cosine * turn.cosine
    steady_rate = omega * (vibration_sine * turn.cosine - vibration_cosine * turn.sine)
    free = free_vibration(body, force, position - steady, velocity - steady_rate)
    offset, a, w, A_1, A_2, _, _ = free
    return Oscillation(offset, a, w, A_1, A_2, vibration_sine, vibration_cosine)


class DecayingSinCos(NamedTuple):
    """Decaying cosine and sine of an ``Oscillation`` at one time: exp(-a s) cos(w s), .. sin."""

    cosine: float
    sine: float
    change: float  # change of the cosine since the start of the segment, without cancellation


# Of every oscillation at its start, and of a resting one.
NO_SWING = DecayingSinCos(1.0, 0.0, 0.0)

# Up to this angle and decay a swing is near [rad, 1].
_NEAR_ANGLE, _NEAR_DECAY = 0.75, 0.3


@compiled
def is_near(decay_rate, angular_frequency, time):
    """Whether a swing is near up to a time."""
    return angular_frequency * time <= _NEAR_ANGLE and decay_rate * time <= _NEAR_DECAY


@compiled
def near_swing(decay_rate, angular_frequency, time):
    """Return the ``DecayingSinCos`` at a near time, without branches."""
    sine, less = sine_and_less(angular_frequency * time)
    growth = growth_near(-decay_rate * time)
    change = growth + (less + growth * less)
    return DecayingSinCos(1.0 + change, sine + growth * sine, change)


@compiled
def swing_at(decay_rate, angular_frequency, time):
    """Return the ``DecayingSinCos`` at a time."""
    if time == 0.0 or angular_frequency == 0.0:
        return NO_SWING
    if is_near(decay_rate, angular_frequency, time):
        return near_swing(decay_rate, angular_frequency, time)
    decay = 1.0
    if decay_rate != 0.0:
        decay = exponential(-decay_rate * time)
    sine, cosine = sin_cos(angular_frequency * time)
    return DecayingSinCos(decay * cosine, decay * sine, decay * cosine - 1.0)


@compiled
def decaying_part(motion, time):
    """Decaying part of an ``Oscillation``, eq. (8): displacement [m] and velocity [m/s]."""
    return swinging_part(motion, swing_at(motion.decay_rate, motion.angular_frequency, time))


@compiled
def swinging_part(motion, swing):
    """Return the same as ``decaying_part``, given the ``DecayingSinCos`` at the time."""
    a = motion.decay_rate
    w = motion.angular_frequency
    cosine = swing.cosine
    sine = swing.sine
    displacement = motion.cosine * cosine + motion.sine * sine
    velocity = (w * motion.sine - a * motion.cosine) * cosine - (
        w * motion.cosine + a * motion.sine
    ) * sine
    return displacement, velocity


@compiled
def swung_integral(motion, swing):
    """Integral of the decaying part from its start to a time [m s], given the swing there."""
    a = motion.decay_rate
    w = motion.angular_frequency
    displacement, velocity = swinging_part(motion, swing)
    start_rate = w * motion.sine - a * motion.cosine
    # From x'' + 2 a x' + (a^2 + w^2) x = 0, integrated once.
    change = velocity - start_rate + 2.0 * a * (displacement - motion.cosine)
    return -change / (a * a + w * w)


@compiled
def reacting_force(weight_on_bit, load_spring_rate, damping, position, velocity):
    """R = W - k_1 u_np - c_1 v_np [N], positive while the drill is pushed toward the rock."""
    return weight_on_bit - load_spring_rate * position - damping * velocity


@compiled
def decaying_derivatives(motion, displacement, velocity):
    """Second [m/s^2] and third [m/s^3] derivative of the decaying part."""
    a = motion.decay_rate
    w = motion.angular_frequency
    square = a * a + w * w
    acceleration = -square * displacement - 2.0 * motion.decay_rate * velocity
    jerk = -square * velocity - 2.0 * motion.decay_rate * acceleration
    return acceleration, jerk


@compiled
def decaying_amplitude(motion):
    """Bound on the decaying part at all later times [m]."""
    return math.sqrt(motion.cosine * motion.cosine + motion.sine * motion.sine)


@compiled
def undamped_frequency(motion):
    """omega_n [rad/s]: by this factor grows, at most, the bound of each further derivative."""
    a = motion.decay_rate
    w = motion.angular_frequency
    return math.sqrt(a * a + w * w)
