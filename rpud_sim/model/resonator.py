"""Resonator: the vibration as a resonance that a voltage feeds and that the contacts load.

The motional branch of the Butterworth-Van Dyke circuit is kept as its envelope z, the complex
voltage across the motional resistance R in the frame of the drive:

    dz/dt = (V - (1 + j delta) z) / tau,  delta = 2 pi (f - f_r) tau

The vibration of the bodies has the amplitude s abs(z) and the sum of the phases of drive and z. The
branch stores tau abs(z)^2 / 4 R, the energy of a modal mass M = tau / (2 R (s Omega)^2) at the tip,
draws V Re(z) / 2 R and heats by abs(z)^2 / 2 R. drawn = heat + work + stored - pending, the last of
which is the work that the next update subtracts.

- A blow on the tip changes velocity and energy of the vibration immediately, unless it is at rest.
- Where the tip holds the free mass, or presses it on the rock, the vibration yields (yielding.py).
- A small vibration is followed in steps, in each of which the drive acts as one impulse; there the
  envelope follows the vibration.
- An update, at a zero of the vibration, gives the bodies the amplitude of the envelope, and the
  frequency that turns their vibration to the envelope's phase until the next update. If the phases
  differ by more than a quarter of a cycle, the vibration is first reversed; at a zero this moves
  nothing. If a contact has taken more energy than is stored, the vibration stays zero until the
  drive has restored the energy.
"""

import math
from typing import NamedTuple

from rpud_sim.model.closed_form import TWO_PI, advance_phase, turn_at, vibration_of
from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import (
    arc_tangent,
    complex_phase,
    complex_quotient,
    complex_size,
    exponential_minus_one,
    hypotenuse,
    sin_cos_cycles,
)
from rpud_sim.model.integrals import exponential_integral
from rpud_sim.model.tolerances import FINE, LOWEST_BOUNCE, SAME_PHASE, STEADY, UPDATES_PER_DECAY


class Resonance(NamedTuple):
    """Constants of the resonance, and the drive at time zero."""

    decay_time: float  # tau = Q / (pi f_r) [s]
    resistance: float  # R [ohm]
    amplitude_per_volt: float  # s [m/V]
    voltage: float  # V [V]
    drive_frequency: float  # f [Hz]
    frequency: float  # f_r [Hz]

    @property
    def mass(self) -> float:
        """M of the vibration at the tip [kg]; infinite if nothing moves it."""
        rate = TWO_PI * self.frequency * self.amplitude_per_volt
        square = self.resistance * rate * rate
        return 0.5 * self.decay_time / square if square > 0.0 else math.inf


class ResonatorEnergy(NamedTuple):
    """Envelope of the resonance at a time, and its energies since time zero."""

    envelope: complex  # z [V]
    drawn: float  # energy from the drive [J]
    heat: float  # heat in the motional resistance [J]
    work: float  # work on the bodies [J]
    stored: float  # energy in the vibration [J]
    pending: float  # work that the next update subtracts from the vibration [J]


@compiled
def stored_energy(state, envelope):
    """Energy of the vibration that belongs to an envelope [J]."""
    square = envelope.real * envelope.real + envelope.imag * envelope.imag
    return 0.25 * state.decay_time * square / state.resistance


@compiled
def per_mass(state):
    """1 / M of the vibration [1/kg]; zero if it is prescribed or at rest."""
    # Blows that set a resting vibration going would let it pump: at a small amplitude a contact
    # gives and takes more in half a cycle than is stored.
    return 1.0 / state.modal_mass if state.resonant and state.amplitude > 0.0 else 0.0


@compiled
def tip_mass(drill, state):
    """Mass with which the tip takes part in a blow [kg]: RPUD and vibration yield both."""
    if not state.resonant:
        return drill.rpud_mass
    return 1.0 / (1.0 / drill.rpud_mass + per_mass(state))


@compiled
def rate_and_target(state):
    """Complex rate [1/s] at which the envelope approaches its end, and that end [V]."""
    detuning = TWO_PI * (state.drive_frequency - state.resonance_frequency) * state.decay_time
    factor = complex(1.0, detuning)
    rate = complex(1.0 / state.decay_time, detuning / state.decay_time)
    return rate, complex_quotient(complex(state.voltage, 0.0), factor)


@compiled
def envelope_after(state, time):
    """Envelope without further contacts [V], and energies drawn and turned to heat so far [J]."""
    elapsed = state.envelope_age + time
    rate, end = rate_and_target(state)
    away = complex(state.envelope_real, state.envelope_imag) - end
    area = away * exponential_integral(-rate, elapsed)
    decay = 2.0 / state.decay_time
    square = (away * away.conjugate()).real * -exponential_minus_one(-decay * elapsed) / decay
    heat = (end * end.conjugate()).real * elapsed + 2.0 * (end.conjugate() * area).real + square
    drawn = state.voltage * (end * elapsed + area).real
    double = 2.0 * state.resistance
    return end + away - rate * area, drawn / double, heat / double


@compiled
def set_envelope(state, envelope):
    state.envelope_real = envelope.real
    state.envelope_imag = envelope.imag
    state.envelope_age = 0.0


@compiled
def advance_envelope(state):
    envelope, drawn, heat = envelope_after(state, 0.0)
    state.drawn += drawn
    state.heat += heat
    set_envelope(state, envelope)
    return envelope


@compiled
def replace_envelope(state, before, after):
    """Replace the envelope [V]; the next update subtracts the energy that this adds."""
    set_envelope(state, after)
    state.pending += stored_energy(state, after) - stored_energy(state, before)


@compiled
def apply_work(state, impulse, work):
    """Let the bodies load the envelope, by work on them [J] and by an impulse.

    The impulse is the integral of the force on the free mass, turned by the drive's phase [N s].
    """
    if not state.amplitude_per_volt > 0.0:
        return  # nothing moves the vibration
    before = advance_envelope(state)
    omega = TWO_PI * state.resonance_frequency
    share = 1.0 / (state.modal_mass * omega * state.amplitude_per_volt)
    replace_envelope(state, before, before - share * impulse)
    state.work += work
    state.pending += work
    if state.steady:
        state.steady = 0
        state.update_due = update_interval(state, state.drive_frequency)


@compiled
def drive_turn(state):
    """Factor that turns a complex number from the tip's frame at phase zero to the drive's."""
    sine, cosine = sin_cos_cycles(state.drive_phase)
    return complex(cosine, -sine)


@compiled
def apply_impact(drill, state, impulse):
    """Let the tip strike: nodal plane and vibration give the impulse [N s] to what is struck.

    The tip stays where it is; amplitude and phase of the vibration follow from its velocity.
    """
    omega = TWO_PI * state.frequency
    u_hv, v_hv = vibration_of(state.amplitude, state.frequency, turn_at(state.phase))
    after = v_hv - impulse * per_mass(state)
    state.v_np -= impulse / drill.rpud_mass
    apply_work(state, impulse * drive_turn(state), 0.5 * impulse * (v_hv + after))
    if after != v_hv:
        phase = arc_tangent(u_hv, after / omega) / TWO_PI
        state.amplitude = hypotenuse(u_hv, after / omega)
        state.phase = phase - math.floor(phase)


@compiled
def apply_hold_impulse(drill, state, v_np, blow_impulse):
    """Take the impulse of bodies that got one velocity, joining the impulse of the blow [N s].

    The vibration keeps its velocity.
    """
    impulse = drill.rpud_mass * (v_np - state.v_np)
    _, v_hv = vibration_of(state.amplitude, state.frequency, turn_at(state.phase))
    mean = v_hv + per_mass(state) * (blow_impulse + 0.5 * impulse)
    apply_work(state, impulse * drive_turn(state), impulse * mean)


@compiled
def move_resonance(state, time):
    """Move the resonance to a time after the start of its segment."""
    state.envelope_age += time
    state.update_due -= time
    state.drive_phase = advance_phase(state.drive_phase, state.drive_frequency, time)


@compiled
def is_fine(state, factor):
    """Whether the vibration is so small that half a cycle of the drive changes much of it."""
    detuned = abs(state.drive_frequency - state.resonance_frequency)
    if detuned * 4.0 * FINE > state.resonance_frequency:
        return False  # the drive hardly moves it
    rise = state.amplitude_per_volt * state.voltage / (2.0 * state.drive_frequency)
    return state.amplitude * state.decay_time < factor * FINE * rise


@compiled
def update_interval(state, frequency):
    """Time from one update to the next [s]: half cycles, fewer where the envelope is small."""
    envelope = complex(state.envelope_real, state.envelope_imag)
    _, end = rate_and_target(state)
    away = complex_size(end - envelope)
    size = min(complex_size(envelope) / away, 1.0) if away > 0.0 else 1.0
    half_cycles = math.ceil(2.0 * frequency * state.decay_time * size / UPDATES_PER_DECAY)
    return 0.5 * max(half_cycles, 1.0) / frequency


@compiled
def phase_error(state, frequency, interval):
    """How far the vibration at a frequency is behind the envelope after an interval [cycles]."""
    envelope, _, _ = envelope_after(state, interval)
    if envelope == 0.0:
        return 0.0
    ahead = state.drive_phase + complex_phase(envelope) / TWO_PI - state.phase
    ahead += (state.drive_frequency - frequency) * interval
    return ahead - math.floor(ahead + 0.5)


@compiled
def plan(state):
    """Choose the vibration's frequency and the next update, from an envelope that holds now."""
    frequency = state.drive_frequency
    envelope = complex(state.envelope_real, state.envelope_imag)
    if envelope != 0.0:
        # The rate at which the envelope turns, between drive and resonance.
        rate, end = rate_and_target(state)
        frequency += complex_quotient(rate * (end - envelope), envelope).imag / TWO_PI
        low = min(state.drive_frequency, state.resonance_frequency)
        frequency = min(
            max(frequency, low), state.drive_frequency + state.resonance_frequency - low
        )
    interval = update_interval(state, frequency)
    error = phase_error(state, frequency, interval)
    if state.amplitude == 0.0:
        # Without amplitude the phase is free.
        state.frequency = frequency
        phase = state.phase + error
        state.phase = phase - math.floor(phase)
    else:
        # Half a cycle of error over half a cycle would be a frequency of zero, for ever.
        if abs(error) > 0.25:
            state.phase = 0.5 - state.phase
            error -= math.copysign(0.5, error)
        state.frequency = frequency + error / interval
    # The update comes at the zero that is nearest to the interval's end.
    state.update_due = interval - 0.25 / state.frequency


@compiled
def begin_resonance(state):
    state.frequency = state.drive_frequency
    state.steady = 1 if state.voltage == 0.0 else 0
    plan(state)
    state.fine = is_fine(state, 1.0)


@compiled
def change_drive(state, voltage, drive_frequency, resonance_frequency):
    """Continue under another drive or resonance; the vibration follows from its next zero on."""
    if (
        voltage == state.voltage
        and drive_frequency == state.drive_frequency
        and resonance_frequency == state.resonance_frequency
    ):
        return
    advance_envelope(state)
    state.voltage = voltage
    state.drive_frequency = drive_frequency
    state.resonance_frequency = resonance_frequency
    state.steady = 0
    state.update_due = 0.0
    if state.amplitude == 0.0:
        plan(state)
    state.fine = is_fine(state, 1.0)


@compiled
def update(state):
    """Give the bodies the envelope's amplitude, at a zero of the vibration."""
    before = advance_envelope(state)
    state.phase = 0.5 if 0.25 < state.phase < 0.75 else 0.0
    energy = stored_energy(state, before)
    left = energy - state.pending
    if left <= 0.0:
        envelope = complex(0.0, 0.0)
    elif energy > 0.0:
        envelope = before * math.sqrt(left / energy)
    else:
        size = math.sqrt(4.0 * state.resistance * left / state.decay_time)
        envelope = (size if state.phase == 0.0 else -size) * drive_turn(state)
    replace_envelope(state, before, envelope)
    _, end = rate_and_target(state)
    away = complex_size(envelope - end)
    tip_away = state.amplitude_per_volt * away
    near = away <= STEADY * complex_size(end) or 0.0 < tip_away <= LOWEST_BOUNCE
    steady = near and abs(phase_error(state, state.drive_frequency, 0.0)) <= SAME_PHASE
    if end == 0.0:
        steady = near or away == 0.0
    if steady:
        replace_envelope(state, envelope, end)
        envelope = end
    state.amplitude = state.amplitude_per_volt * complex_size(envelope)
    if steady:
        state.steady = 1
        state.frequency = state.drive_frequency
        return
    plan(state)
    state.fine = is_fine(state, 1.0)


@compiled
def time_to_update(due, phase, frequency):
    """Time until the next zero of the vibration at which an update that is due comes [s]."""
    half_cycles = 2.0 * (phase + frequency * max(due, 0.0))
    return (0.5 * math.floor(half_cycles) + 0.5 - phase) / frequency
