"""The amplitude of a run with an actuator: at its start, off resonance, and without a drive."""

import dataclasses
import math

from drill_configurations import FULL, RESONANT

from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.simulation import Simulation

FIXED = dataclasses.replace(RESONANT, generator="fixed")
SECOND = 1_000_000_000
MILLISECOND = 1_000_000


def test_the_actuator_rings_up_from_rest_as_its_segments_show():
    simulation = Simulation(Configuration(actuator=FIXED))
    amplitude = simulation.advance_to(100 * MILLISECOND).segments["vibration_amplitude"]
    assert amplitude[0] == 0.0
    # The impacts load it, so that it stays below its nominal amplitude.
    assert 5e-6 < amplitude.max() < 36e-6


def test_the_resonance_drifts_and_comes_back():
    def greatest(time):
        return simulation.advance_to(time).segments["vibration_amplitude"].max()

    simulation = Simulation(Configuration(actuator=FIXED))
    before = greatest(SECOND)
    number = simulation.inject(Fault("resonance_drift", magnitude=-100.0))
    assert simulation.actuator.resonance_frequency == 15_900.0
    simulation.advance_to(SECOND + 100 * MILLISECOND)
    assert greatest(2 * SECOND) < 0.5 * before
    simulation.clear(number)
    simulation.advance_to(2 * SECOND + 100 * MILLISECOND)
    assert greatest(3 * SECOND) > 0.7 * before


def test_a_drive_that_is_off_rings_down():
    simulation = Simulation(FULL)
    simulation.advance_to(SECOND)
    simulation.apply(Drive(False, 0.0, 0.0))
    amplitude = simulation.advance_to(SECOND + 10 * MILLISECOND).open_segment[
        "vibration_amplitude"
    ][0]
    # The impacts load it, so that it falls faster than by itself.
    assert 0.0 < amplitude < 35e-6 * math.exp(-0.01 * math.pi * 32.0)
    assert simulation.advance_to(2 * SECOND).open_segment["vibration_amplitude"] == 0.0
