"""The harmonic vibration, eq. (1)."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.model.closed_form import advance_phase, harmonic_vibration, time_to_zero_displacement

PHASES = st.floats(0.0, 1.0, exclude_max=True)
FREQUENCIES = st.floats(100.0, 2e5)


@given(phase=PHASES)
def test_displacement_and_velocity_are_those_of_the_paper(phase):
    time = phase / 16000.0
    u_hv, v_hv = harmonic_vibration(35e-6, 16000.0, phase)
    assert u_hv == pytest.approx(35e-6 * math.sin(2 * math.pi * 16000 * time), abs=1e-18)
    speed = 2 * math.pi * 16000 * 35e-6
    assert v_hv == pytest.approx(speed * math.cos(2 * math.pi * 16000 * time), abs=1e-13)


@given(phase=PHASES, frequency=FREQUENCIES, duration=st.floats(0.0, 0.01))
def test_phase_stays_within_a_cycle(phase, frequency, duration):
    advanced = advance_phase(phase, frequency, duration)
    assert 0.0 <= advanced <= 1.0
    cycles = (phase + frequency * duration) % 1.0
    assert min(abs(advanced - cycles), 1.0 - abs(advanced - cycles)) < 1e-12


@given(phase=PHASES, frequency=FREQUENCIES)
def test_next_zero_comes_within_half_a_cycle(phase, frequency):
    time = time_to_zero_displacement(phase, frequency)
    assert 0.0 < time <= 0.5 / frequency
    u_hv, _ = harmonic_vibration(1.0, frequency, phase + frequency * time)
    assert abs(u_hv) < 1e-14
