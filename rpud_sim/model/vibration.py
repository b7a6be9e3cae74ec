"""Harmonic vibration of the actuator's bottom side: eqs. (1) and (3)."""

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import sin_cos_cycles

TWO_PI = 2.0 * math.pi


class Turn(NamedTuple):
    """Sine and cosine of the phase angle: computed once for all that is wanted at one instant."""

    sine: float
    cosine: float


@compiled
def turn_at(phase):
    """Return the ``Turn`` of a phase [cycles]."""
    sine, cosine = sin_cos_cycles(phase)
    return Turn(sine, cosine)


@compiled
def vibration_of(amplitude, frequency, turn):
    """Displacement and velocity of the harmonic vibration, eq. (1), given its ``Turn``."""
    return amplitude * turn.sine, TWO_PI * frequency * amplitude * turn.cosine


@compiled
def harmonic_vibration(amplitude, frequency, phase):
    """Displacement and velocity of the harmonic vibration, eq. (1).

    Args:
        phase: f_0 t [cycles]; kept in cycles because one cycle is a whole number.

    Returns:
        u_hv [m] and v_hv [m/s], positive toward the rock.
    """
    return vibration_of(amplitude, frequency, turn_at(phase))


@compiled
def advance_phase(phase, frequency, duration):
    """Phase after a duration [s], from 0 to 1 [cycles]."""
    advanced = phase + frequency * duration
    return advanced - math.floor(advanced)


@compiled
def time_to_zero_displacement(phase, frequency):
    """Time until the vibration next passes through zero displacement [s], never zero.

    At such an instant the amplitude can change without moving the actuator's tip.
    """
    half_cycles = 2.0 * phase
    return 0.5 * (math.floor(half_cycles) + 1.0 - half_cycles) / frequency
