"""Integrals of a segment's motion in closed form, for the engine and for its audit.

Within a segment every force and velocity is a sum of ``Re(z exp(rate s))``, complex ``z`` and rate.
"""

from typing import NamedTuple

from rpud_sim.model.closed_form import TWO_PI, swinging_part
from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import (
    complex_exponential,
    complex_quotient,
    complex_size,
    exponential_minus_one,
    sin_cos,
)
from rpud_sim.model.segment import (
    CONTACT_BOTH,
    drill_tool_motion,
    load_of,
    nodal_plane_motion,
    slow_tip_motion,
    vibration_turn,
)

# Exponents below this are integrated as a series.
_SHORT = 1e-9


@compiled
def growth_over(rate, duration):
    """Return exp(rate s) - 1 without cancellation, with a complex rate [1/s]."""
    size = exponential_minus_one(rate.real * duration)
    half, cosine = sin_cos(0.5 * rate.imag * duration)
    real = size - (size + 1.0) * (2.0 * half * half)
    return complex(real, (size + 1.0) * (2.0 * half * cosine))


@compiled
def exponential_integral(rate, duration):
    """Integral of exp(rate s) over a duration, with a complex rate [1/s]."""
    largest = max(abs(rate.real), abs(rate.imag))  # without a root where it is large enough
    if largest * duration < _SHORT and complex_size(rate) * duration < _SHORT:
        return duration * (1.0 + 0.5 * rate * duration)
    return complex_quotient(growth_over(rate, duration), rate)


@compiled
def product_integral(first, first_rate, second, second_rate, duration):
    """Integral of Re(first exp(first_rate s)) Re(second exp(second_rate s)) over a duration."""
    other, other_rate = second.conjugate(), second_rate.conjugate()
    total = first * second * exponential_integral(first_rate + second_rate, duration)
    total += first * other * exponential_integral(first_rate + other_rate, duration)
    return 0.5 * total.real


@compiled
def travel_of(motion, begun, ended):
    """Travel of a decaying part between two ``DecayingSinCos`` [m].

    A difference of positions would lose the digits that the deflection of a soft spring takes.
    """
    change = ended.change - begun.change
    return motion.cosine * change + motion.sine * (ended.sine - begun.sine)


@compiled
def damper_loss(damping, motion, begun, ended):
    """Energy that a damping takes from a decaying part between two ``DecayingSinCos`` [J].

    x'' + 2 a x' + (a^2 + w^2) x = 0 times x', integrated once: no other function is needed.
    """
    a = motion.decay_rate
    if damping == 0.0 or a == 0.0:
        return 0.0
    w = motion.angular_frequency
    u_begun, v_begun = swinging_part(motion, begun)
    u_ended, v_ended = swinging_part(motion, ended)
    lost = (v_begun - v_ended) * (v_begun + v_ended)
    lost -= (a * a + w * w) * travel_of(motion, begun, ended) * (u_begun + u_ended)
    return 0.25 * damping / a * lost


@compiled
def square_integral(first, first_rate, second, second_rate, duration):
    """Integral of the square of Re(first exp(first_rate s)) + Re(second exp(second_rate s))."""
    return (
        product_integral(first, first_rate, first, first_rate, duration)
        + 2.0 * product_integral(first, first_rate, second, second_rate, duration)
        + product_integral(second, second_rate, second, second_rate, duration)
    )


class HeldMotion(NamedTuple):
    """Motion of a tip that holds the free mass, from a time on, in complex parts."""

    decaying: complex  # amplitude of the nodal plane's decaying part [m]
    added: complex  # what the yielding vibration adds to it at the tip [m]
    rate: complex  # rate at which it decays [1/s]
    steady: complex  # amplitude of the nodal plane's steady vibration [m]
    tip: complex  # amplitude of the tip's steady vibration [m]
    turn: complex  # exp(i phi)
    omega: complex  # rate of the vibration [1/s]


@compiled
def held_motion(segment, start):
    motion = nodal_plane_motion(segment)
    rate = complex(-motion.decay_rate, motion.angular_frequency)
    decaying = complex(motion.cosine, -motion.sine)
    added = complex(0.0, 0.0)
    if segment.contact == CONTACT_BOTH:
        added = complex(segment.drill_tool_cosine, -segment.drill_tool_sine)
    if start > 0.0:
        decay = complex_exponential(rate * start)
        decaying *= decay
        added *= decay
    sine, cosine = vibration_turn(segment, start)
    turn = complex(cosine, sine)
    steady = complex(motion.vibration_cosine, -motion.vibration_sine) * turn
    omega = complex(0.0, TWO_PI * segment.vibration_frequency)
    tip = steady + complex(0.0, -segment.vibration_amplitude) * turn
    return HeldMotion(decaying, added, rate, steady, tip, turn, omega)


@compiled
def drill_tool_damper_loss(segment, start, end, begun, ended):
    """Energy that the damping of the drill tool takes in a part of a segment [J].

    ``begun`` and ``ended`` are its ``DecayingSinCos`` at the start and the end of the part.
    """
    damping = segment.drill_tool_damping
    if segment.contact != CONTACT_BOTH:
        return damper_loss(damping, drill_tool_motion(segment), begun, ended)
    if damping == 0.0:
        return 0.0
    held = held_motion(segment, start)
    return damping * square_integral(
        held.rate * (held.decaying + held.added),
        held.rate,
        held.omega * held.tip,
        held.omega,
        end - start,
    )


@compiled
def force_parts(segment, held):
    """Force of the tip on what it holds [N]: constant, and amplitudes of decay and vibration."""
    rate, omega = held.rate, held.omega
    mass, damping, spring_rate, force = load_of(segment, True)
    constant = spring_rate * slow_tip_motion(segment).offset - force
    slow = (mass * rate * rate + damping * rate + spring_rate) * (held.decaying + held.added)
    fast = (mass * omega * omega + damping * omega + spring_rate) * held.tip
    return constant, slow, fast


@compiled
def vibration_work(segment, held, duration):
    """Work of the vibration on the free mass that the tip holds [J].

    The integral of N v_hv, N the force of the tip; the nodal plane's work stays among the bodies.
    """
    constant, slow, fast = force_parts(segment, held)
    rate, omega = held.rate, held.omega
    velocity = abs(omega.imag) * segment.vibration_amplitude * held.turn
    work = (
        constant * (velocity * exponential_integral(omega, duration)).real
        + product_integral(slow, rate, velocity, omega, duration)
        + product_integral(fast, omega, velocity, omega, duration)
    )
    if held.added != 0.0:
        velocity = rate * held.added
        work += (
            constant * (velocity * exponential_integral(rate, duration)).real
            + product_integral(slow, rate, velocity, rate, duration)
            + product_integral(fast, omega, velocity, rate, duration)
        )
    return work
