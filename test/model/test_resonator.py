"""The resonance follows its equation, gives and takes energy exactly, and rests when it may."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from support import examples

from rpud_sim.model import resonator
from rpud_sim.model.closed_form import advance_phase, turn_at, vibration_of
from rpud_sim.model.drill import STATE, derive
from rpud_sim.model.parameters import preset
from rpud_sim.model.resonator import Resonance

TAU = 500.0 / (math.pi * 16000.0)
RESISTANCE = 100.0
SCALE = 35e-6 / 100.0
RESONANCE = Resonance(TAU, RESISTANCE, SCALE, 100.0, 16000.0, 16000.0)
NOMINAL = 100.0 * SCALE


def made(resonance=RESONANCE, phase=0.2):
    """A resonance at rest."""
    state = np.zeros(1, STATE)[0]
    state["resonant"] = 1
    state["phase"] = state["drive_phase"] = phase
    state["decay_time"], state["resistance"], state["amplitude_per_volt"] = resonance[:3]
    state["voltage"], state["drive_frequency"], state["resonance_frequency"] = resonance[3:]
    state["modal_mass"] = resonance.mass
    resonator.begin_resonance(state)
    return state


def time_to_update(state):
    return resonator.time_to_update(state["update_due"], state["phase"], state["frequency"])


def updates(state, most=20_000):
    """Advance without load until it is steady; yield time, amplitude and frequency."""
    time = 0.0
    for _ in range(most):
        if state["steady"]:
            return
        step = time_to_update(state)
        resonator.move_resonance(state, step)
        state["phase"] = advance_phase(state["phase"], state["frequency"], step)
        resonator.update(state)
        time += step
        yield time, float(state["amplitude"]), float(state["frequency"])
    raise AssertionError("it never comes to rest")


def balance(state):
    """Energies drawn, and those that it went to."""
    stored = resonator.stored_energy(state, complex(state["envelope_real"], state["envelope_imag"]))
    return state["drawn"], state["heat"] + state["work"] + stored - state["pending"]


@settings(max_examples=examples(20), deadline=None)
@given(st.floats(-100.0, 100.0), st.floats(0.0, 200.0), st.floats(1e-5, 0.03))
def test_envelope_and_energies_follow_their_equations(detuning, voltage, time):
    state = made(RESONANCE._replace(voltage=voltage, drive_frequency=16000.0 + detuning))
    state["envelope_real"], state["envelope_imag"] = 30.0, -20.0
    rate = complex(1.0, 2.0 * math.pi * detuning * TAU) / TAU

    def change(_, y):
        z = complex(y[0], y[1])
        slope = voltage / TAU - rate * z
        return slope.real, slope.imag, voltage * z.real / 200.0, abs(z) ** 2 / 200.0

    expected = solve_ivp(change, (0, time), (30, -20, 0, 0), rtol=1e-10, atol=1e-12).y[:, -1]
    envelope, drawn, heat = resonator.envelope_after(state, time)
    assert (envelope.real, envelope.imag, drawn, heat) == pytest.approx(
        expected, rel=1e-6, abs=1e-7
    )


def test_it_rings_up_and_down_with_its_time_constant():
    state = made()
    for time, amplitude, frequency in updates(state):
        assert amplitude == pytest.approx(-NOMINAL * math.expm1(-time / TAU), rel=2e-3)
        assert frequency == pytest.approx(16000.0, abs=1e-6)
    assert state["amplitude"] == NOMINAL
    assert np.diff(balance(state)) == pytest.approx(0.0, abs=1e-12)

    resonator.change_drive(state, 0.0, 16000.0, 15990.0)
    for time, amplitude, frequency in updates(state):
        if amplitude > 0.0:
            # What was pending for taking the end as reached is given back at first.
            assert amplitude == pytest.approx(NOMINAL * math.exp(-time / TAU), rel=2e-3)
            assert frequency == pytest.approx(15990.0, abs=5.0)
    assert state["amplitude"] == 0.0
    assert np.diff(balance(state)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("side", [-0.5, 0.5])
def test_half_the_power_is_left_half_a_bandwidth_away(side):
    state = made(RESONANCE._replace(drive_frequency=16000.0 + side * 32.0))
    list(updates(state))
    assert state["amplitude"] == pytest.approx(NOMINAL / math.sqrt(2.0), rel=1e-9)
    envelope, drawn, _ = resonator.envelope_after(state, 1.0)
    assert cmath.phase(envelope) == pytest.approx(-math.copysign(math.pi / 4.0, side))
    assert drawn == pytest.approx(25.0, rel=1e-9)


@settings(max_examples=examples(50), deadline=None)
@given(st.floats(0.0, 1.0), st.floats(1e-3, 10.0), st.floats(-80.0, 80.0))
def test_a_vibration_on_the_wrong_side_turns_round_at_its_zero(turn, size, detuning):
    state = made(RESONANCE._replace(drive_frequency=16000.0 + detuning))
    resonator.set_envelope(state, cmath.rect(size, 2.0 * math.pi * turn))
    state["amplitude"], state["phase"] = SCALE * size, 0.0
    resonator.plan(state)
    assert 7900.0 < state["frequency"] < 24200.0
    assert 0.0 < time_to_update(state) < 2.0 / 7900.0
    assert len(list(updates(state))) < 1000
    assert state["amplitude"] > 0.0


VOLTAGES = st.just(0.0) | st.floats(1e-9, 1e3)  # of a subnormal one all bits can be lost


@settings(max_examples=examples(30), deadline=None)
@given(st.floats(100.0, 2e5), st.floats(100.0, 2e5), st.floats(10.0, 1e5), VOLTAGES)
def test_updates_are_few_however_far_from_resonance_and_however_sharp(f, f_r, quality, voltage):
    decay_time = quality / (math.pi * f_r)
    state = made(Resonance(decay_time, 100.0, SCALE, voltage, f, f_r))
    found = list(updates(state))
    assert len(found) < 1000
    assert all(frequency > 0.0 and math.isfinite(amplitude) for _, amplitude, frequency in found)
    resonator.change_drive(state, 0.0, f, f_r)
    assert len(list(updates(state))) < 1500
    assert state["amplitude"] == 0.0


@settings(max_examples=examples(50), deadline=None)
@given(st.floats(0.0, 1.0), st.floats(-0.1, 0.1))
def test_a_blow_moves_no_tip_and_takes_its_work_from_the_vibration(phase, impulse):
    drill = derive(preset("drilling"))
    state = made()
    list(updates(state))
    state["phase"] = state["drive_phase"] = phase % 1.0
    state["v_np"] = 0.3
    pending = float(state["pending"])
    mass = TAU / (2.0 * RESISTANCE * (SCALE * 2.0 * math.pi * 16000.0) ** 2)
    u, v = vibration_of(state["amplitude"], state["frequency"], turn_at(state["phase"]))
    before = balance(state)[1] - state["work"] + state["pending"]
    resonator.apply_impact(drill, state, impulse)
    u_after, v_after = vibration_of(state["amplitude"], state["frequency"], turn_at(state["phase"]))
    assert u_after == pytest.approx(u, abs=1e-18)
    assert state["v_np"] == pytest.approx(0.3 - impulse / drill.rpud_mass, abs=1e-15)
    assert v_after == pytest.approx(v - impulse / mass, abs=1e-12)
    assert state["work"] == pytest.approx(0.5 * mass * (v**2 - v_after**2), abs=1e-13)
    # The envelope was the vibration's, so that nothing is pending.
    after = balance(state)[1] - state["work"] + state["pending"]
    assert before - after == pytest.approx(state["work"], abs=1e-12)
    assert state["pending"] == pytest.approx(pending, abs=1e-12)
    assert resonator.tip_mass(drill, state) == pytest.approx(
        1.0 / (1.0 / drill.rpud_mass + 1 / mass)
    )
