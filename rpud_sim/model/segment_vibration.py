"""Vibration of a resonance in the open segment: where it ends, and how small ones are followed.

Where the vibration yields, or is small, the bodies' motion defines what it becomes, and
the envelope follows it. Elsewhere it continues by itself until the envelope's next update
(resonator.py).
"""

import math

from rpud_sim.model.closed_form import TWO_PI, advance_phase, turn_at, vibration_of
from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import arc_tangent, hypotenuse, sin_cos_cycles
from rpud_sim.model.integrals import held_motion, vibration_work
from rpud_sim.model.resonator import (
    ResonatorEnergy,
    advance_envelope,
    envelope_after,
    is_fine,
    move_resonance,
    replace_envelope,
    set_envelope,
    stored_energy,
    update_interval,
)
from rpud_sim.model.segment import CONTACT_ACTUATOR, tip_motion, turns_at
from rpud_sim.model.tolerances import LOWEST_BOUNCE
from rpud_sim.model.yielding import (
    FREE_STEP,
    YIELDS_TO_MASS,
    YIELDS_TO_ROCK,
    forces_on,
    impulses_on,
)


@compiled
def follows(state):
    """Whether the envelope follows the vibration in the open segment, not the other way round."""
    return state.fine or state.yields == YIELDS_TO_ROCK


@compiled
def brought(state):
    """Envelope that the segment began with [V], and energies drawn and heated till then [J]."""
    _, drawn, heat = envelope_after(state, 0.0)
    return complex(state.envelope_real, state.envelope_imag), drawn, heat


@compiled
def envelope_of(state, amplitude, phase, drive_phase):
    """Envelope of a vibration [V], given the phase of the drive at its time [cycles]."""
    sine, cosine = sin_cos_cycles(phase - drive_phase)
    return amplitude / state.amplitude_per_volt * complex(cosine, sine)


@compiled
def alone_after(state, time):
    """Envelope that the vibration at the start of a segment would have after a time [V]."""
    return envelope_of(
        state,
        state.amplitude,
        state.phase + state.frequency * time,
        state.drive_phase + state.drive_frequency * time,
    )


@compiled
def yielded(state, segment, time, turns):
    """Vibration after a part of a segment: amplitude, phase, travel [m] and work on bodies [J].

    An envelope that follows it is the envelope about the resonance frequency.
    """
    u_np, v_np, u_ut, v_ut = tip_motion(segment, turns.vibration, turns.nodal_plane)
    frequency = state.resonance_frequency if follows(state) else state.frequency
    u_hv, v_hv = u_ut - u_np, (v_ut - v_np) / (TWO_PI * frequency)
    begun, _ = vibration_of(state.amplitude, state.frequency, turn_at(state.phase))
    phase = arc_tangent(u_hv, v_hv) / TWO_PI
    work = 0.0
    if segment.contact & CONTACT_ACTUATOR:
        work = vibration_work(segment, held_motion(segment, 0.0), time)
    return hypotenuse(u_hv, v_hv), phase - math.floor(phase), u_hv - begun, work


@compiled
def account(state, segment, time):
    """``ResonatorEnergy`` at a time since the start of the open segment [s]; changes nothing."""
    envelope, drawn, heat = envelope_after(state, time)
    work = 0.0
    pending = state.pending
    if state.yields or state.fine:
        amplitude, phase, travel, work = yielded(state, segment, time, turns_at(segment, time))
        turned = state.drive_phase + state.drive_frequency * time
        after = envelope_of(state, amplitude, phase, turned)
        if follows(state):
            before, drawn, heat = brought(state)
            if state.yields == YIELDS_TO_ROCK:
                drawn += state.drive_force * travel
                heat -= state.loss_force * travel
            pending += heat - drawn - stored_energy(state, before)
            envelope = after
        else:
            envelope += after - alone_after(state, time)
            pending -= stored_energy(state, envelope_after(state, time)[0])
        pending += work + stored_energy(state, envelope)
    drawn += state.drawn
    work += state.work
    advanced = max(work - drawn, 0.0)
    return ResonatorEnergy(
        envelope,
        drawn + advanced,
        state.heat + heat,
        work,
        stored_energy(state, envelope),
        pending - advanced,
    )


@compiled
def drive_on(drill, state, time, travel):
    """Let drive and losses of the time before this instant act on the vibration.

    They act as one impulse, which the tip shares with a free mass that it carries. Returns the
    energies drawn, heated and given to the bodies [J].
    """
    omega = TWO_PI * state.frequency
    lightness = 1.0 / state.modal_mass
    drive, loss = impulses_on(state, time, travel)
    drive -= state.ahead
    state.ahead = 0.0
    u_hv, v_hv = vibration_of(state.amplitude, state.frequency, turn_at(state.phase))
    given = 0.0
    if state.yields == YIELDS_TO_MASS:
        whole = 1.0 / drill.free_mass + 1.0 / drill.rpud_mass + lightness
        given = (drive + loss) * lightness / whole
        state.v_np -= given / drill.rpud_mass
        state.v_fm += given / drill.free_mass
    after = v_hv + (drive + loss - given) * lightness
    mean = 0.5 * (v_hv + after)
    phase = arc_tangent(u_hv, after / omega) / TWO_PI
    state.amplitude = hypotenuse(u_hv, after / omega)
    state.phase = phase - math.floor(phase)
    state.given = given
    return drive * mean, -loss * mean, given * (after + 0.5 * given * lightness)


@compiled
def end_vibration(drill, state, segment, time, turns):
    """Move resonance and vibration to a time in the open segment, where it ends."""
    state.given = 0.0
    if not (state.yields or state.fine):
        state.phase = advance_phase(state.phase, state.frequency, time)
        move_resonance(state, time)
        return
    amplitude, phase, travel, work = yielded(state, segment, time, turns)
    if not follows(state):
        # What the free mass changes of the vibration loads the envelope as a blow does.
        alone = alone_after(state, time)
        move_resonance(state, time)
        before = advance_envelope(state)
        change = envelope_of(state, amplitude, phase, state.drive_phase) - alone
        replace_envelope(state, before, before + change)
        state.work += work
        state.pending += work
        state.amplitude, state.phase = amplitude, phase
        if state.steady:
            state.steady = 0
            state.update_due = update_interval(state, state.drive_frequency)
        return
    before, drawn, heat = brought(state)
    state.amplitude, state.phase = amplitude, phase
    state.frequency = state.resonance_frequency
    if state.yields == YIELDS_TO_ROCK:
        drawn += state.drive_force * travel
        heat -= state.loss_force * travel
    else:
        drive, loss, given = drive_on(drill, state, time, travel)
        drawn += drive
        heat += loss
        work += given
    move_resonance(state, time)
    envelope = envelope_of(state, state.amplitude, state.phase, state.drive_phase)
    set_envelope(state, envelope)
    state.drawn += drawn
    state.heat += heat
    state.work += work
    state.pending += work + heat - drawn
    state.pending += stored_energy(state, envelope) - stored_energy(state, before)
    state.steady = 0
    state.update_due = 0.0
    state.fine = is_fine(state, 2.0 if state.fine else 1.0)
    if not state.fine:
        state.missing = 0.0
    if state.voltage == 0.0 and state.amplitude <= LOWEST_BOUNCE:
        replace_envelope(state, envelope, complex(0.0, 0.0))
        state.amplitude = 0.0


# Share of the velocity by which a step draws the tip away, below which bodies part too slowly.
NEARLY = 0.1


@compiled
def draw_back(state, impulse_given):
    """Let a drive that draws the tip away from bodies that it touches act ahead of its time.

    Else they would meet again and again until its step ends. The tip has given the bodies an
    impulse at this instant [N s], whose work is impulse times mean velocity.
    """
    force, _ = forces_on(state, 0.0)
    impulse = force * FREE_STEP / state.drive_frequency
    omega = TWO_PI * state.frequency
    u_hv, v_hv = vibration_of(state.amplitude, state.frequency, turn_at(state.phase))
    after = v_hv + impulse / state.modal_mass
    if not state.v_fm - state.v_np - v_hv < NEARLY * (v_hv - after):
        return
    phase = arc_tangent(u_hv, after / omega) / TWO_PI
    state.amplitude = hypotenuse(u_hv, after / omega)
    state.phase = phase - math.floor(phase)
    state.ahead = impulse
    work = impulse_given * (after - v_hv)
    drawn = impulse * 0.5 * (v_hv + after) + work
    state.work += work
    before = advance_envelope(state)
    envelope = envelope_of(state, state.amplitude, state.phase, state.drive_phase)
    replace_envelope(state, before, envelope)
    state.drawn += drawn
    state.pending += work - drawn
